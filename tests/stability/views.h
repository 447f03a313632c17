#pragma once

// Hard cases as pictures, and the distance of pictures from one another.

#include <functional>
#include <string>

#include <surfel/render/renderer.h>
#include <surfel/sample/hard_cases.h>
#include <surfel/scene/framing.h>
#include <surfel/truth/reference.h>

#include "stability/place.h"

namespace surfel::test {

/// The case's camera; for tests the middle of its picture alone, as large in pixels.
Camera case_camera(const CameraOptions& view, Effort effort);

/// Unlit.
Image draw(const SurfelCloud& cloud, const Camera& camera, RenderOptions options = {});
/// The same by ray casting: `--reference`.
Image draw_reference(const SurfelCloud& cloud, const Camera& camera, Effort effort,
                     RenderOptions options = {});

/// PSNR of the whole pictures, dB; 99.9 at most.
double psnr(const Image& image, const Image& truth);

/// PSNR in linear light over the pixels opaque in `truth`, alpha included, dB; 99.9 at most. What
/// edges look like is measured on its own.
double psnr_inside(const Image& image, const Image& truth);

/// Root mean square of the differences in linear R, G, B, A, over the pixels that `use` accepts.
double rms(const Image& image, const Image& truth,
           const std::function<bool(int x, int y)>& use = {});

/// "NAME:NUMBER".
std::string named(const std::string& name, double number);

}  // namespace surfel::test
