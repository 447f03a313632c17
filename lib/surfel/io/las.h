#pragma once

#include <surfel/io/cloud_io.h>
#include <surfel/io/input_file.h>
#include <surfel/scene/surfel_cloud.h>

namespace surfel {

/// Reads the points of a LAS or LAZ file: versions 1.0 to 1.4, point formats 0 to 10. LAZ is
/// decompressed chunk by chunk, in parallel; of a COPC file only the nodes that the options ask for
/// are, and points outside of the options' bounds may be among them. The header is checked against
/// the file's size before anything is allocated. Fields and extra bytes become columns (LasLayout);
/// colours are 8-bit where none is larger than 255, else 16-bit, and left out where all are zero,
/// as writers without colours store them. Up is z. SurfelCloud::las tells how the points were
/// stored; positions keep every step of the file's scale where up to 2^24 of them lie across the
/// points. Throws Error(kInput) naming the file. Internal to the io module.
SurfelCloud read_las(const InputFile& file, const CloudReadOptions& options);

}  // namespace surfel
