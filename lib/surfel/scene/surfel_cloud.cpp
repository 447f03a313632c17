#include <algorithm>
#include <atomic>
#include <cmath>
#include <cstring>

#include <surfel/base/error.h>
#include <surfel/base/parallel.h>
#include <surfel/scene/column_pairs.h>
#include <surfel/scene/surfel_cloud.h>

namespace surfel {
namespace {

constexpr std::size_t kSurfelGrain = 1 << 16;

}  // namespace

const Array<Vec3f>* SurfelCloud::render_color() const {
  if (!coefficient.empty()) return &coefficient;
  return color.empty() ? nullptr : &color;
}

Bounds SurfelCloud::bounds() const {
  const std::size_t blocks = (size() + kSurfelGrain - 1) / kSurfelGrain;
  std::vector<Bounds> partial(blocks);
  parallel_for(size(), kSurfelGrain, [&](std::size_t begin, std::size_t end, int) {
    Bounds box;
    for (std::size_t i = begin; i < end; ++i) {
      if (position[i].allFinite()) box.add(world(i));
    }
    partial[begin / kSurfelGrain] = box;
  });
  Bounds box;
  for (const Bounds& b : partial) {
    if (b.empty()) continue;
    box.add(b.min);
    box.add(b.max);
  }
  return box;
}

Array<Vec3d> SurfelCloud::sensors() const {
  const auto scan = std::find_if(extra.begin(), extra.end(),
                                 [](const ExtraProperty& p) { return p.name == "scan"; });
  if (scan_viewpoints.empty() || scan == extra.end()) return {};
  Array<Vec3d> found(size());
  std::atomic<bool> all = true;
  parallel_for(size(), kSurfelGrain, [&](std::size_t begin, std::size_t end, int) {
    for (std::size_t i = begin; i < end; ++i) {
      double number = 0;
      load_scalars(scan->type, scan->data.data() + i * scalar_size(scan->type), 1, &number);
      if (!(number >= 0 && number < static_cast<double>(scan_viewpoints.size()))) {
        all = false;
        return;
      }
      found[i] = scan_viewpoints[static_cast<std::size_t>(number)].position;
    }
  });
  if (!all) return {};
  return found;
}

SurfelCloud SurfelCloud::gathered(const Array<std::uint32_t>& order) const {
  SurfelCloud out;
  // File-wide values first; the columns are filled below.
  out.origin = origin;
  out.double_positions = double_positions;
  out.decimals = decimals;
  out.color_encoding = color_encoding;
  out.alpha_as_uint8 = alpha_as_uint8;
  out.color_light = color_light;
  out.basis_cutoff = basis_cutoff;
  out.provenance = provenance;
  out.comments = comments;
  out.viewpoint = viewpoint;
  out.scan_viewpoints = scan_viewpoints;
  out.up = up;
  out.las = las;

  const auto gather = [&](const auto& from, auto& to) {
    if (from.empty()) return;
    to.resize(order.size());
    parallel_for(order.size(), kSurfelGrain, [&](std::size_t begin, std::size_t end, int) {
      for (std::size_t i = begin; i < end; ++i) to[i] = from[order[i]];
    });
  };
  visit_column_pairs(*this, out, gather);
  for (const ExtraProperty& property : extra) {
    ExtraProperty to{property.name, property.type, {}};
    const std::size_t bytes = scalar_size(property.type);
    to.data.resize(order.size() * bytes);
    parallel_for(order.size(), kSurfelGrain, [&](std::size_t begin, std::size_t end, int) {
      for (std::size_t i = begin; i < end; ++i) {
        std::memcpy(to.data.data() + i * bytes, property.data.data() + order[i] * bytes, bytes);
      }
    });
    out.extra.push_back(std::move(to));
  }
  return out;
}

void SurfelCloud::check_columns(const std::string& name) const {
  visit_columns(*this, [&](const auto& column) {
    if (!column.empty() && column.size() != size()) {
      throw_input(name, "columns differ in length (" + std::to_string(column.size()) + " and " +
                            std::to_string(size()) + ")");
    }
  });
  if (const std::string problem = tree_problem(tree, size()); !problem.empty()) {
    throw_input(name, "its levels of detail are broken: " + problem + "; run surfel-lod again");
  }
  for (const ExtraProperty& property : extra) {
    if (property.data.size() != size() * scalar_size(property.type)) {
      throw_input(name, "column " + property.name + " has the wrong length");
    }
  }
}

}  // namespace surfel
