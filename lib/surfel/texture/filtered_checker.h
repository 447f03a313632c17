#pragma once

#include <surfel/base/export.h>
#include <surfel/base/types.h>
#include <surfel/texture/kernel_axes.h>

namespace surfel {

/// The checker of unit cubes in space, averaged over a Gaussian that lies in a plane: +1 where
/// floor(x) + floor(y) + floor(z) is even, -1 where it is odd. In the plane, cubes end at three
/// families of parallel lines.
///
/// Kernels of at least 0.4 cubes along both axes: the sum over the Fourier series of the three
/// square waves, each term damped by exp(-pi^2 |D^T k|^2 / 2). Many of these kernels average to
/// nearly 0, but not all: the checker on a plane whose normal is (1, 1, 1) has a mean of its own.
/// Smaller kernels: exact along lines, which cut the kernel in a direction that is at least 30
/// degrees from all borders, by the normal distribution at the borders; the midpoint rule across.
/// The error is below 0.004 in both cases.
/// Kernels narrower than 0.4 and longer than 8 cubes are shortened to 8 cubes. Points beyond 2^52,
/// where a double has no fractions, get 0.
///
/// \param point, axes  in cubes.
SURFEL_API double filtered_checker(const Vec3d& point, const KernelAxes& axes);

}  // namespace surfel
