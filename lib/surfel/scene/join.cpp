#include <Eigen/Geometry>
#include <algorithm>
#include <cmath>
#include <cstring>
#include <limits>
#include <numeric>
#include <unordered_map>

#include <fmt/format.h>
#include <surfel/base/error.h>
#include <surfel/base/parallel.h>
#include <surfel/scene/amplitude.h>
#include <surfel/scene/join.h>
#include <surfel/scene/surfel_variance.h>

namespace surfel {
namespace {

constexpr std::size_t kJoinGrain = 1 << 16;
constexpr std::size_t kMostMaterials = std::size_t{1} << 16;  ///< A surfel's material has 16 bits.

Vec3f any_tangent(const SurfelCloud& cloud, std::size_t i) {
  if (cloud.normal.empty() || !(cloud.normal[i].squaredNorm() > 0)) return {1, 0, 0};
  return cloud.normal[i].unitOrthogonal();
}

void append_new(std::vector<std::string>& to, const std::vector<std::string>& lines) {
  for (const std::string& line : lines) {
    if (std::find(to.begin(), to.end(), line) == to.end()) to.push_back(line);
  }
}

void use_materials(std::vector<SurfelCloud>& clouds, const JoinOptions& options,
                   std::span<const std::string> names) {
  for (std::size_t k = 0; k < options.material.size(); ++k) {
    if (options.material[k] < 0) continue;
    clouds[k].material.assign(clouds[k].size(), static_cast<std::uint16_t>(options.material[k]));
  }
  if (!options.separate_materials) return;
  std::size_t first = 0;
  for (std::size_t k = 0; k < clouds.size(); ++k) {
    Array<std::uint16_t>& rows = clouds[k].material;
    if (rows.empty()) rows.assign(clouds[k].size(), 0);
    if (rows.empty()) continue;
    const std::size_t last = first + *std::max_element(rows.begin(), rows.end());
    if (last >= kMostMaterials) {
      throw_input(names[k], fmt::format("its materials would take rows {} to {}, and there are "
                                        "65536; give rows as `material`",
                                        first, last));
    }
    for (std::uint16_t& row : rows) row = static_cast<std::uint16_t>(row + first);
    first = last + 1;
  }
}

class Joiner {
 public:
  Joiner(const std::vector<SurfelCloud>& clouds, std::span<const std::string> names,
         JoinReport& report)
      : clouds_(clouds), names_(names), report_(report) {
    for (const SurfelCloud& cloud : clouds) {
      first_.push_back(total_);
      total_ += cloud.size();
    }
    if (total_ > std::numeric_limits<std::uint32_t>::max()) {
      throw_input("", fmt::format("together there are {} surfels, more than 2^32 - 1", total_));
    }
  }

  SurfelCloud join() {
    join_file();
    join_color_light();
    join_positions();
    const auto unknown = [](const auto&, std::size_t) { return Vec3f(0, 0, 0); };
    fill("normal", &SurfelCloud::normal, unknown);
    fill("shading_normal", &SurfelCloud::shading_normal, unknown);
    join_variances();
    join_colors();
    keep("uv", &SurfelCloud::uv);
    keep("dpdu", &SurfelCloud::dpdu);
    keep("dpdv", &SurfelCloud::dpdv);
    const auto zero = [](const auto&, std::size_t) { return 0; };
    fill("material", &SurfelCloud::material, zero);
    keep("group", &SurfelCloud::group);
    keep("group_radius", &SurfelCloud::group_radius);
    join_sources();
    fill("level", &SurfelCloud::level, zero);
    join_extra();
    return std::move(out_);
  }

 private:
  template <class Has>
  bool any(Has&& has) const {
    return std::any_of(clouds_.begin(), clouds_.end(), has);
  }
  template <class Has>
  bool all(Has&& has) const {
    return std::all_of(clouds_.begin(), clouds_.end(), has);
  }

  /// A column that some clouds have; surfel i of another cloud gets value(cloud, i).
  template <class T, class Value>
  void fill(const char* name, Array<T> SurfelCloud::*column, Value&& value) {
    if (!any([&](const SurfelCloud& c) { return !(c.*column).empty(); })) return;
    (out_.*column).resize(total_);
    for (std::size_t k = 0; k < clouds_.size(); ++k) {
      const SurfelCloud& cloud = clouds_[k];
      const Array<T>& from = cloud.*column;
      T* to = (out_.*column).data() + first_[k];
      if (from.empty() && !cloud.empty()) report_.filled.push_back({k, name});
      parallel_for(cloud.size(), kJoinGrain, [&](std::size_t begin, std::size_t end, int) {
        for (std::size_t i = begin; i < end; ++i) {
          to[i] = from.empty() ? static_cast<T>(value(cloud, i)) : from[i];
        }
      });
    }
  }

  /// A column that stays where all clouds have it.
  template <class T>
  void keep(const char* name, Array<T> SurfelCloud::*column) {
    const auto has = [&](const SurfelCloud& c) { return !(c.*column).empty() || c.empty(); };
    if (!all(has)) {
      if (any([&](const SurfelCloud& c) { return !(c.*column).empty(); })) {
        report_.dropped.emplace_back(name);
      }
      return;
    }
    fill(name, column, [](const SurfelCloud&, std::size_t) { return T{}; });
  }

  void join_file() {
    out_.viewpoint = clouds_.front().viewpoint;
    out_.up = clouds_.front().up;
    out_.las = clouds_.front().las;
    out_.decimals = clouds_.front().decimals;
    for (const SurfelCloud& cloud : clouds_) {
      if (!cloud.decimals) out_.decimals.reset();
      if (out_.decimals) out_.decimals = std::max(*out_.decimals, *cloud.decimals);
      append_new(out_.provenance, cloud.provenance);
      append_new(out_.comments, cloud.comments);
      out_.double_positions = out_.double_positions || cloud.double_positions;
      if (cloud.up != out_.up) out_.up.reset();
      const auto& v = cloud.viewpoint;
      if (!v || !out_.viewpoint || v->position != out_.viewpoint->position ||
          v->orientation != out_.viewpoint->orientation) {
        out_.viewpoint.reset();
      }
    }
  }

  /// What the colours of all clouds are. Colourless surfels get a grey to be lit.
  void join_color_light() {
    std::optional<ColorLight> common;
    std::optional<ColorLight> meaning;
    bool said_alike = true;
    bool alike = true;
    for (const SurfelCloud& cloud : clouds_) {
      if (cloud.empty()) continue;
      const ColorLight means = cloud.render_color() ? meaning_of_colors(cloud.color_light, true)
                                                    : ColorLight::kReflectance;
      said_alike = said_alike && common.value_or(cloud.color_light) == cloud.color_light;
      alike = alike && meaning.value_or(means) == means;
      common = cloud.color_light;
      meaning = means;
    }
    if (!common || !any([](const SurfelCloud& c) { return c.render_color() != nullptr; })) {
      if (said_alike) out_.color_light = common.value_or(ColorLight::kUnsaid);
    } else if (!alike) {
      out_.color_light = ColorLight::kMixed;
    } else {
      out_.color_light = said_alike ? *common : *meaning;
    }
  }

  void join_positions() {
    Bounds box;
    for (const SurfelCloud& cloud : clouds_) {
      const Bounds b = cloud.bounds();
      if (b.empty()) continue;
      box.add(b.min);
      box.add(b.max);
    }
    out_.origin = float_origin(box);
    out_.position.resize(total_);
    for (std::size_t k = 0; k < clouds_.size(); ++k) {
      const SurfelCloud& cloud = clouds_[k];
      const Vec3d shift = cloud.origin - out_.origin;
      Vec3f* to = out_.position.data() + first_[k];
      std::vector<double> rounding(cloud.size() / kJoinGrain + 1, 0);
      parallel_for(cloud.size(), kJoinGrain, [&](std::size_t begin, std::size_t end, int) {
        for (std::size_t i = begin; i < end; ++i) {
          const Vec3d offset = shift + cloud.position[i].cast<double>();
          to[i] = offset.cast<float>();
          const double change = (to[i].cast<double>() - offset).cwiseAbs().maxCoeff();
          if (change > rounding[begin / kJoinGrain]) rounding[begin / kJoinGrain] = change;
        }
      });
      report_.rounding =
          std::max(report_.rounding, *std::max_element(rounding.begin(), rounding.end()));
    }
  }

  void join_variances() {
    if (!any(has_variance)) {
      fill("area", &SurfelCloud::area, [](const auto&, std::size_t) { return 0; });
      return;
    }
    for (std::size_t k = 0; k < clouds_.size(); ++k) {
      if (clouds_[k].empty() || has_variance(clouds_[k])) continue;
      throw_input(names_[k],
                  "has no variance (nor radius), and others do; run surfel-estimate on it");
    }
    if (!any([](const SurfelCloud& c) { return c.anisotropic(); })) {
      keep("variance", &SurfelCloud::variance);
    } else {
      // Where a cloud has both kinds of variances, the anisotropic ones win.
      if (all([](const SurfelCloud& c) { return !c.variance.empty(); })) {
        keep("variance", &SurfelCloud::variance);
      }
      const auto isotropic = [](const SurfelCloud& c, std::size_t i) { return c.variance[i]; };
      fill("tangent", &SurfelCloud::tangent, any_tangent);
      fill("variance_u", &SurfelCloud::variance_u, isotropic);
      fill("variance_v", &SurfelCloud::variance_v, isotropic);
    }
    fill("area", &SurfelCloud::area, root_of_determinant<>);
  }

  void join_colors() {
    bool floats = false;
    bool wide = false;
    out_.alpha_as_uint8 = true;
    const std::optional<double>* basis = nullptr;
    for (const SurfelCloud& cloud : clouds_) {
      if (!cloud.color.empty()) {
        floats = floats || cloud.color_encoding == ColorEncoding::kFloatLinear;
        wide = wide || cloud.color_encoding == ColorEncoding::kUint16Srgb;
      }
      if (!cloud.alpha.empty()) out_.alpha_as_uint8 = out_.alpha_as_uint8 && cloud.alpha_as_uint8;
      if (cloud.coefficient.empty()) continue;
      if (basis && *basis != cloud.basis_cutoff) report_.basis_differs = true;
      basis = &cloud.basis_cutoff;
    }
    out_.color_encoding = floats ? ColorEncoding::kFloatLinear
                          : wide ? ColorEncoding::kUint16Srgb
                                 : ColorEncoding::kUint8Srgb;
    if (basis && !report_.basis_differs) out_.basis_cutoff = *basis;
    fill("color", &SurfelCloud::color,
         [](const auto&, std::size_t) { return SurfelCloud::colorless(); });
    fill("alpha", &SurfelCloud::alpha, [](const auto&, std::size_t) { return 1; });
    fill("coefficient", &SurfelCloud::coefficient, [](const SurfelCloud& c, std::size_t i) {
      return c.color.empty() ? SurfelCloud::colorless() : c.color[i];
    });
  }

  /// Numbers of its own for every cloud, in the order in which the splats come.
  void join_sources() {
    if (!any([](const SurfelCloud& c) { return !c.source.empty(); })) return;
    out_.source.resize(total_);
    std::uint32_t next = 0;
    for (std::size_t k = 0; k < clouds_.size(); ++k) {
      const Array<std::uint32_t>& from = clouds_[k].source;
      std::uint32_t* to = out_.source.data() + first_[k];
      std::unordered_map<std::uint32_t, std::uint32_t> number;
      for (std::size_t i = 0; i < clouds_[k].size(); ++i) {
        if (from.empty()) {
          to[i] = next++;
          continue;
        }
        const auto [entry, is_new] = number.try_emplace(from[i], next);
        if (is_new) ++next;
        to[i] = entry->second;
      }
    }
  }

  void join_extra() {
    for (const SurfelCloud& cloud : clouds_) {
      for (const ExtraProperty& property : cloud.extra) {
        const auto same = [&](const ExtraProperty& p) { return p.name == property.name; };
        const auto known = std::find_if(out_.extra.begin(), out_.extra.end(), same);
        if (known == out_.extra.end()) {
          out_.extra.push_back({property.name, property.type, {}});
        } else if (known->type != property.type) {
          known->type = ScalarType::kFloat64;
        }
      }
    }
    for (ExtraProperty& property : out_.extra) fill_extra(property);
  }

  void fill_extra(ExtraProperty& property) {
    const std::size_t bytes = scalar_size(property.type);
    property.data.assign(total_ * bytes, std::byte{0});
    for (std::size_t k = 0; k < clouds_.size(); ++k) {
      const std::vector<ExtraProperty>& extra = clouds_[k].extra;
      const auto from = std::find_if(extra.begin(), extra.end(), [&](const ExtraProperty& p) {
        return p.name == property.name;
      });
      if (from == extra.end()) {
        report_.filled.push_back({k, property.name});
        continue;
      }
      std::byte* to = property.data.data() + first_[k] * bytes;
      if (from->type == property.type) {
        std::copy(from->data.begin(), from->data.end(), to);
        continue;
      }
      const std::size_t stride = scalar_size(from->type);
      for (std::size_t i = 0; i < clouds_[k].size(); ++i) {
        double value = 0;
        load_scalars(from->type, from->data.data() + i * stride, 1, &value);
        std::memcpy(to + i * bytes, &value, bytes);
      }
    }
  }

  const std::vector<SurfelCloud>& clouds_;
  std::span<const std::string> names_;
  JoinReport& report_;
  std::vector<std::size_t> first_;
  std::size_t total_ = 0;
  SurfelCloud out_;
};

}  // namespace

std::vector<std::string> JoinOptions::problems(std::size_t clouds) const {
  std::vector<std::string> found;
  if (!material.empty() && material.size() != clouds) {
    found.push_back(fmt::format("there are {} material rows for {} clouds; give one for each",
                                material.size(), clouds));
  }
  for (const int row : material) {
    if (row < -1 || row >= static_cast<int>(kMostMaterials)) {
      found.push_back(fmt::format("`material` is {}; it must be in 0..65535", row));
    }
  }
  if (!material.empty() && separate_materials) {
    found.emplace_back("materials are given and to be separated; leave out one of the two");
  }
  return found;
}

SurfelCloud join_clouds(std::vector<SurfelCloud> clouds, const JoinOptions& options,
                        std::span<const std::string> names, JoinReport* report) {
  for (const std::string& problem : options.problems(clouds.size())) throw_usage(problem);
  for (std::size_t k = 0; k < clouds.size(); ++k) clouds[k].check_columns(names[k]);
  use_materials(clouds, options, names);
  if (clouds.empty()) return {};
  if (clouds.size() == 1) return std::move(clouds.front());
  JoinReport unused;
  return Joiner(clouds, names, report ? *report : unused).join();
}

}  // namespace surfel
