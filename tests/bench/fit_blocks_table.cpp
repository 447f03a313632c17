// Fits in blocks beside fits of all surfels at once, for docs/texture.md: a row for each fit and
// width of the halo, in six blocks or more. Usage: fit_blocks_table NAME SURFELS MESH [IMAGE],
// SURFELS in space-filling order and sampled from MESH. Where FIT_CLOUD names a file, the cloud
// that the render fit for c = 1 makes at once goes there, and nothing else is done.

#include <algorithm>
#include <cmath>
#include <cstdlib>
#include <string>
#include <vector>

#include <fmt/format.h>
#include <surfel/io/cloud_io.h>
#include <surfel/io/mesh_io.h>
#include <surfel/scene/surfel_ranges.h>
#include <surfel/texture/fit_blocks.h>
#include <surfel/texture/texture_source.h>

namespace {

using namespace surfel;

struct Fit {
  const char* name;
  TextureFitOptions options;
};

std::vector<Fit> fits() {
  std::vector<Fit> all(4);
  all[0] = {"render, c = 1", {}};
  all[0].options.kind = TextureFitKind::kRender;
  all[1] = {"render, c = 2", all[0].options};
  all[1].options.cutoff = 2;
  all[2] = {"gram", {}};
  all[2].options.kind = TextureFitKind::kGram;
  all[3] = {"gram, normalised", all[2].options};
  all[3].options.right_side = GramRightSide::kNormalised;
  return all;
}

/// Takes coefficients.
class Coefficients final : public SurfelSink {
 public:
  void begin(const SurfelCloud&, std::size_t count) override { w.resize(count); }
  void put(SurfelCloud surfels, std::size_t at) override {
    std::copy(surfels.coefficient.begin(), surfels.coefficient.end(),
              w.begin() + static_cast<std::ptrdiff_t>(at));
  }
  Array<Vec3f> w;
};

struct Difference {
  double largest = 0;
  double mean = 0;  ///< Root mean square over channels.
};

Difference difference(const Array<Vec3f>& a, const Array<Vec3f>& b) {
  Difference d;
  for (std::size_t k = 0; k < a.size(); ++k) {
    const Vec3f difference = a[k] - b[k];
    d.largest = std::max(d.largest, static_cast<double>(difference.cwiseAbs().maxCoeff()));
    d.mean += static_cast<double>(difference.squaredNorm());
  }
  d.mean = std::sqrt(d.mean / (3 * static_cast<double>(a.size())));
  return d;
}

}  // namespace

int main(int argc, char** argv) {
  const std::vector<std::string> arguments(argv + 1, argv + argc);
  const SurfelCloud cloud = read_cloud(arguments.at(1));
  const TriangleMesh mesh = read_mesh(arguments.at(2));
  TextureSourceOptions source;
  if (arguments.size() > 3) source.image = arguments[3];
  TextureSet textures = load_textures(source, &mesh, arguments[2]);
  const OrderedCloud ordered(cloud);
  const SurfelCloud sorted = ordered.read(0, cloud.size());
  if (const char* path = std::getenv("FIT_CLOUD")) {
    SurfelCloud whole = sorted;
    fit_texture(whole, textures, fits()[0].options);
    write_cloud(whole, path);
    return 0;
  }
  for (const Fit& fit : fits()) {
    SurfelCloud whole = sorted;
    const TextureFitReport at_once = fit_texture(whole, textures, fit.options);
    const auto row = [&](const std::string& width, double lambda, const Array<Vec3f>& w) {
      const Difference d = difference(w, whole.coefficient);
      fmt::print("| {} | {} | {} | {:.6f} | {:.1e} | {:.1e} |\n", arguments[0], fit.name, width,
                 lambda, d.largest, d.mean);
      std::fflush(stdout);
    };
    TextureFitOptions exact = fit.options;
    exact.tolerance /= 100;
    exact.lambda = at_once.system->lambda;
    SurfelCloud solved = sorted;
    fit_texture(solved, textures, exact);
    row("whole, a hundredth of the tolerance", at_once.system->lambda, solved.coefficient);
    for (const double width : {2, 4, 8, 12, 16, 24}) {
      Coefficients blocks;
      TextureFitReport report;
      fit_by_blocks(OrderedCloud(sorted), {.textures = &textures}, fit.options, blocks, &report,
                    "surfels", {.most = cloud.size() / 6, .halo = width});
      row(fmt::format("{}", width), report.system->lambda, blocks.w);
    }
  }
}
