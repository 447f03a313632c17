#pragma once

#include <string>
#include <vector>

#include <surfel/io/gaussian_io.h>
#include <surfel/scene/gaussian_cloud.h>

#include "tools/support/tool.h"

namespace surfel::tool {

/// Says a name's extension that its file holds Gaussians alone (.splat, .usda)?
bool names_gaussians(const std::string& path);

/// Throws Error(kUsage) where Gaussians of a file `input` are not written to a file of that name.
void require_gaussian_name(const std::string& path, const std::string& input);

/// Reads files of Gaussians and joins them, reports the time that takes (`load_ms`), and tells how
/// many were left out. Throws Error(kUsage) where one file holds no Gaussians, and what
/// read_gaussians() and join_gaussians() throw.
/// \param options  for each file.
GaussianCloud load_gaussians(Tool& tool, const std::vector<std::string>& files,
                             const GaussianReadOptions& options = {});

/// Writes the Gaussians that a tool made, with its line of provenance, tells what the format has no
/// place for, and reports their number (`gaussians`).
void write_result(Tool& tool, const GaussianCloud& cloud, const std::string& path);

}  // namespace surfel::tool
