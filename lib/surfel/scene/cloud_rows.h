#pragma once

#include <cstddef>

#include <surfel/base/export.h>
#include <surfel/scene/surfel_cloud.h>

namespace surfel {

/// Bytes of memory that a surfel takes in a cloud of the same columns.
SURFEL_API std::size_t row_bytes(const SurfelCloud& cloud);

/// A cloud of so many surfels with the columns of another cloud, and with all that holds for the
/// whole of that one. Its values are to be filled in.
SURFEL_API SurfelCloud cloud_of_rows(const SurfelCloud& like, std::size_t rows);

/// Copies the surfels [begin, end) of a cloud to the rows from `at` on of one of the same columns.
SURFEL_API void copy_rows(const SurfelCloud& from, std::size_t begin, std::size_t end,
                          SurfelCloud& to, std::size_t at);

}  // namespace surfel
