#pragma once

#include <surfel/base/types.h>

namespace surfel {

/// Gaussian in space that lies in a plane. The columns are two half-axes at one standard deviation,
/// conjugate but not necessarily orthogonal: its variance is D D^T. Zero: a point.
using KernelAxes = Eigen::Matrix<double, 3, 2, Eigen::DontAlign>;

}  // namespace surfel
