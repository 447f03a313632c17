#pragma once

#include <cstddef>
#include <vector>

#include <surfel/base/export.h>
#include <surfel/base/types.h>
#include <surfel/report/info_page.h>
#include <surfel/scene/image.h>
#include <surfel/scene/surfel_cloud.h>

namespace surfel {

/// Surfels that charts are made of, at most: a file with more is sampled.
inline constexpr std::size_t kChartSurfels = 200000;

/// Charts of the surfels' sizes, of what they stand for, of their elevation, colours and opacities,
/// and of all columns that the library gives no meaning to: numbers between the values that 98 in
/// 100 lie between, categories by their numbers.
/// \param cloud  All surfels, or a sample of them.
/// \param up     Direction of elevation.
/// \param note   A line for every chart that says which surfels are shown, such as "one in 7
///               surfels".
SURFEL_API std::vector<InfoChart> cloud_charts(const SurfelCloud& cloud, const Vec3d& up,
                                               const std::string& note);

/// Charts of a picture's colours.
SURFEL_API std::vector<InfoChart> image_charts(const Image& image);

}  // namespace surfel
