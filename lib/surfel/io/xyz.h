#pragma once

#include <string>

#include <surfel/io/input_file.h>
#include <surfel/scene/surfel_cloud.h>

namespace surfel {

/// Does the name end like a text file of points (.xyz .txt .pts .asc .csv .xyzn .xyzrgb)?
bool is_xyz_name(const std::string& path);

/// Reads points from text, one a line (LF, CR LF or CR): numbers parted by blanks, tabs, commas or
/// semicolons. Lines that are empty or begin with # or // are skipped. A first line of one whole
/// number is the count (PTS), and so is one where as many have been read; a line of names gives the
/// columns (those of PLY; others are kept as properties), and so does a comment above the points
/// that has as many words as they have columns, x, y and z among them. Without names their number
/// decides:
///   3  x y z
///   4  x y z intensity
///   6  x y z nx ny nz, where all lines' last three make a length of 1 within 1 %, or 0 (unknown),
///   else r g b 7  x y z intensity r g b 9  x y z r g b nx ny nz, or with the last two triples
///   changed, whichever has length 1
/// Colours are whole numbers 0..255 (sRGB), 0..65535, or else 0..1 (linear). Throws Error(kInput)
/// with the line: not a number, more or fewer columns than before, fewer or more lines than the
/// count says. Internal to the io module.
SurfelCloud read_xyz(const InputFile& file);

}  // namespace surfel
