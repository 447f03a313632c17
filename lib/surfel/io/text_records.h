#pragma once

#include <cstddef>
#include <string>
#include <vector>

#include <surfel/io/record_table.h>
#include <surfel/scene/surfel_cloud.h>

namespace surfel {

/// Gives each name that repeats an earlier one, case aside, a number behind it that makes it the
/// only one. Internal to the io module.
void number_repeated_names(std::vector<std::string>& names);

/// Appends a record as a line of text; every value reads back as it was. Internal to the io module.
/// \param separator  between two values
void append_record(const std::byte* record, const std::vector<RecordColumn>& columns,
                   char separator, std::string& text);

/// Does XyzPoints know the columns without their names, as other programs do? So are coordinates,
/// alone or with normals, with colours that are codes, or with both.
bool are_known_columns(const std::vector<RecordColumn>& columns);

/// The line above the points of a text file that names the columns, as XyzPoints reads it: a
/// comment, or with commas as CSV has it. Characters that would end a name become underscores, and
/// names that differ in their case alone get numbers, since readers ignore case.
std::string column_line(const std::vector<RecordColumn>& columns, char separator);
/// A line for each column that column_line() gives another name.
std::vector<std::string> renamed_in_text(const std::vector<RecordColumn>& columns);

/// The points [begin, end) as vertices of OBJ: positions, colours as sRGB in 0..1 behind them,
/// where MeshLab and others expect them, and normals.
std::string obj_points(const SurfelCloud& cloud, std::size_t begin, std::size_t end);

/// The columns of a cloud that OBJ has no place for.
std::vector<std::string> columns_without_place_in_obj(const SurfelCloud& cloud);

}  // namespace surfel
