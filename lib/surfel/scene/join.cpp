#include <Eigen/Geometry>
#include <algorithm>
#include <atomic>
#include <charconv>
#include <cstring>
#include <limits>
#include <optional>
#include <unordered_map>

#include <fmt/format.h>
#include <surfel/base/coordinate_spread.h>
#include <surfel/base/error.h>
#include <surfel/base/parallel.h>
#include <surfel/scene/amplitude.h>
#include <surfel/scene/column_pairs.h>
#include <surfel/scene/coordinate_system.h>
#include <surfel/scene/exact_coordinates.h>
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

template <class Has>
bool any_of(const std::vector<SurfelCloud>& clouds, const Has& has) {
  return std::any_of(clouds.begin(), clouds.end(), has);
}

/// A property by its name; null where there is none.
template <class Cloud>
auto* find_extra(Cloud& cloud, const std::string& name) {
  const auto found = std::find_if(cloud.extra.begin(), cloud.extra.end(),
                                  [&](const ExtraProperty& p) { return p.name == name; });
  return found == cloud.extra.end() ? nullptr : &*found;
}

bool same_view(const Viewpoint& a, const Viewpoint& b) {
  return a.position == b.position && a.orientation == b.orientation;
}

/// The viewpoints of a cloud's scans, in the order of their numbers; empty where they are unknown.
std::vector<Viewpoint> views_of(const SurfelCloud& cloud) {
  if (!cloud.scan_viewpoints.empty() && find_extra(cloud, "scan")) return cloud.scan_viewpoints;
  if (cloud.viewpoint) return {*cloud.viewpoint};
  return {};
}

/// Comments "scan 0: Hall" name scans by their number, which is another one in the joined cloud.
std::vector<std::string> renumbered(std::vector<std::string> comments, std::size_t first) {
  constexpr std::string_view kScan = "scan ";
  for (std::string& comment : comments) {
    const std::size_t colon = comment.find(':');
    if (!comment.starts_with(kScan) || colon == std::string::npos) continue;
    std::size_t number = 0;
    const char* const end = comment.data() + colon;
    const auto [stop, error] = std::from_chars(comment.data() + kScan.size(), end, number);
    if (error != std::errc{} || stop != end) continue;
    comment = fmt::format("{}{}{}", kScan, number + first, comment.substr(colon));
  }
  return comments;
}

/// Makes coordinates exact that count as exact by their decimals, or by the steps of their file.
void keep_exact(SurfelCloud& cloud) {
  const ExactCoordinates coordinates(cloud, true);
  Array<Vec3d> exact(cloud.size());
  parallel_each(cloud.size(), kJoinGrain, [&](std::size_t i) { exact[i] = coordinates(i); });
  cloud.exact = std::move(exact);
  parallel_each(cloud.size(), kJoinGrain, [&](std::size_t i) { cloud.place(i, cloud.exact[i]); });
  cloud.decimals.reset();
}

}  // namespace

struct CloudJoiner::Impl {
  std::vector<SurfelCloud> heads;
  JoinOptions options;
  std::vector<std::string> names;
  JoinReport report;
  SurfelCloud header;  ///< What holds for the joined cloud as a whole; of `extra` names and types.
  /// Of each cloud the number that its first scan gets; empty where scans keep their numbers.
  std::vector<std::size_t> first_scan;
  // What the clouds before the one that is being joined have taken, and this one so far.
  std::size_t current = 0;
  std::size_t first_row = 0;  ///< Of the material table.
  std::size_t next_row = 0;
  std::unordered_map<std::uint32_t, std::uint32_t> source_number;
  std::uint32_t next_source = 0;
  /// Where names of columns that are filled go, while the report is made.
  std::vector<JoinReport::Filled>* noted = nullptr;

  Impl(std::vector<SurfelCloud> of, JoinOptions how, std::vector<std::string> called);
  SurfelCloud join(std::size_t k, SurfelCloud cloud);

  bool any(auto SurfelCloud::*column) const {
    return any_of(heads, [&](const SurfelCloud& c) { return !(c.*column).empty(); });
  }
  bool all(auto SurfelCloud::*column) const {
    return !any_of(heads, [&](const SurfelCloud& c) { return (c.*column).empty() && !c.empty(); });
  }
  bool anisotropic() const { return any(&SurfelCloud::tangent); }

  void plan_views();
  void plan_system();
  void plan_color_light();
  void plan_colors();
  void plan_extra();
  void require_variances() const;
  void report_columns();

  void use_material(std::size_t k, SurfelCloud& cloud);
  template <class T, class Value>
  void fill(std::size_t k, SurfelCloud& cloud, const char* name, Array<T> SurfelCloud::*column,
            const Value& value) const;
  void fill_columns(std::size_t k, SurfelCloud& cloud) const;
  Array<std::byte> numbered_scans(std::size_t k, const SurfelCloud& cloud, ScalarType type) const;
  void fill_extra(std::size_t k, SurfelCloud& cloud) const;
  void number_sources(SurfelCloud& cloud);
};

CloudJoiner::Impl::Impl(std::vector<SurfelCloud> of, JoinOptions how,
                        std::vector<std::string> called)
    : heads(std::move(of)), options(std::move(how)), names(std::move(called)) {
  for (const std::string& problem : options.problems(heads.size())) throw_usage(problem);
  if (heads.size() < 2) return;
  for (std::size_t k = 0; k < heads.size(); ++k) {
    const bool given = !options.material.empty() && options.material[k] >= 0;
    if (given || options.separate_materials) heads[k].material.assign(heads[k].size(), 0);
  }
  require_variances();
  header.up = heads.front().up;
  header.las = heads.front().las;
  plan_views();
  for (std::size_t k = 0; k < heads.size(); ++k) {
    const SurfelCloud& cloud = heads[k];
    append_new(header.provenance, cloud.provenance);
    append_new(header.comments,
               first_scan.empty() ? cloud.comments : renumbered(cloud.comments, first_scan[k]));
    header.double_positions = header.double_positions || cloud.double_positions;
    if (cloud.up != header.up) header.up.reset();
  }
  plan_system();
  plan_color_light();
  plan_colors();
  plan_extra();
  report_columns();
}

/// Decides on the viewpoints: as they are where all clouds have the same, else one for each scan of
/// each cloud.
void CloudJoiner::Impl::plan_views() {
  std::vector<std::vector<Viewpoint>> views;
  for (const SurfelCloud& cloud : heads) views.push_back(views_of(cloud));
  const auto same = [&](const std::vector<Viewpoint>& other) {
    return std::equal(other.begin(), other.end(), views[0].begin(), views[0].end(), same_view);
  };
  if (std::all_of(views.begin(), views.end(), same)) {
    header.viewpoint = heads.front().viewpoint;
    header.scan_viewpoints = heads.front().scan_viewpoints;
    return;
  }
  const auto unknown = [](const std::vector<Viewpoint>& of) { return of.empty(); };
  if (std::any_of(views.begin(), views.end(), unknown)) {
    report.viewpoints_dropped = true;
    return;
  }
  for (const std::vector<Viewpoint>& of : views) {
    first_scan.push_back(header.scan_viewpoints.size());
    header.scan_viewpoints.insert(header.scan_viewpoints.end(), of.begin(), of.end());
  }
}

/// Leaves out the coordinate system where the clouds have different ones.
void CloudJoiner::Impl::plan_system() {
  std::optional<CoordinateSystem> known;
  bool alike = true;
  for (const SurfelCloud& cloud : heads) {
    const std::optional<CoordinateSystem> system = coordinate_system(cloud.comments);
    alike = alike && (!system || !known || *system == *known);
    if (system) known = system;
  }
  if (alike) return;
  set_coordinate_system(header, std::nullopt);
  report.dropped.emplace_back("coordinate system");
}

/// What the colours of all clouds are. Colourless surfels get a grey to be lit.
void CloudJoiner::Impl::plan_color_light() {
  std::optional<ColorLight> common;
  std::optional<ColorLight> meaning;
  bool said_alike = true;
  bool alike = true;
  for (const SurfelCloud& cloud : heads) {
    if (cloud.empty()) continue;
    const ColorLight means = cloud.render_color() ? meaning_of_colors(cloud.color_light, true)
                                                  : ColorLight::kReflectance;
    said_alike = said_alike && common.value_or(cloud.color_light) == cloud.color_light;
    alike = alike && meaning.value_or(means) == means;
    common = cloud.color_light;
    meaning = means;
  }
  const auto colored = [](const SurfelCloud& c) { return c.render_color() != nullptr; };
  if (!common || !any_of(heads, colored)) {
    if (said_alike) header.color_light = common.value_or(ColorLight::kUnsaid);
  } else if (!alike) {
    header.color_light = ColorLight::kMixed;
  } else {
    header.color_light = said_alike ? *common : *meaning;
  }
}

void CloudJoiner::Impl::plan_colors() {
  bool floats = false;
  bool wide = false;
  header.alpha_as_uint8 = true;
  const std::optional<double>* basis = nullptr;
  for (const SurfelCloud& cloud : heads) {
    if (!cloud.color.empty()) {
      floats = floats || cloud.color_encoding == ColorEncoding::kFloatLinear;
      wide = wide || cloud.color_encoding == ColorEncoding::kUint16Srgb;
    }
    if (!cloud.alpha.empty()) header.alpha_as_uint8 = header.alpha_as_uint8 && cloud.alpha_as_uint8;
    if (cloud.coefficient.empty()) continue;
    if (basis && *basis != cloud.basis_cutoff) report.basis_differs = true;
    basis = &cloud.basis_cutoff;
  }
  header.color_encoding = floats ? ColorEncoding::kFloatLinear
                          : wide ? ColorEncoding::kUint16Srgb
                                 : ColorEncoding::kUint8Srgb;
  if (basis && !report.basis_differs) header.basis_cutoff = *basis;
}

void CloudJoiner::Impl::plan_extra() {
  for (const SurfelCloud& cloud : heads) {
    for (const ExtraProperty& property : cloud.extra) {
      ExtraProperty* const known = find_extra(header, property.name);
      if (!known) {
        header.extra.push_back({property.name, property.type, {}});
      } else if (known->type != property.type) {
        known->type = ScalarType::kFloat64;
      }
    }
  }
  if (first_scan.empty()) return;
  std::erase_if(header.extra, [](const ExtraProperty& p) { return p.name == "scan"; });
  const bool few = header.scan_viewpoints.size() <= std::size_t{1} << 16;
  header.extra.push_back({"scan", few ? ScalarType::kUint16 : ScalarType::kUint32, {}});
}

void CloudJoiner::Impl::require_variances() const {
  if (!any_of(heads, has_variance)) return;
  for (std::size_t k = 0; k < heads.size(); ++k) {
    if (heads[k].empty() || has_variance(heads[k])) continue;
    throw_input(names[k], "has no variance (nor radius), and others do; run surfel-estimate on it");
  }
}

/// Tells which columns are filled and which are dropped.
void CloudJoiner::Impl::report_columns() {
  noted = &report.filled;
  for (std::size_t k = 0; k < heads.size(); ++k) {
    SurfelCloud head = heads[k];
    fill_columns(k, head);
    fill_extra(k, head);
  }
  noted = nullptr;
  const auto drops = [&](const char* name, auto SurfelCloud::*column) {
    if (any(column) && !all(column)) report.dropped.emplace_back(name);
  };
  drops("uv", &SurfelCloud::uv);
  drops("dpdu", &SurfelCloud::dpdu);
  drops("dpdv", &SurfelCloud::dpdv);
  drops("group", &SurfelCloud::group);
  drops("group_radius", &SurfelCloud::group_radius);
}

void CloudJoiner::Impl::use_material(std::size_t k, SurfelCloud& cloud) {
  if (!options.material.empty() && options.material[k] >= 0) {
    cloud.material.assign(cloud.size(), static_cast<std::uint16_t>(options.material[k]));
  }
  if (!options.separate_materials || cloud.empty()) return;
  Array<std::uint16_t>& rows = cloud.material;
  if (rows.empty()) rows.assign(cloud.size(), 0);
  const std::size_t last = first_row + *std::max_element(rows.begin(), rows.end());
  if (last >= kMostMaterials) {
    throw_input(names[k], fmt::format("its materials would take rows {} to {}, and there are "
                                      "65536; give rows as `material`",
                                      first_row, last));
  }
  for (std::uint16_t& row : rows) row = static_cast<std::uint16_t>(row + first_row);
  next_row = std::max(next_row, last + 1);
}

/// Gives a cloud a column that another one has: surfel i gets value(i).
template <class T, class Value>
void CloudJoiner::Impl::fill(std::size_t k, SurfelCloud& cloud, const char* name,
                             Array<T> SurfelCloud::*column, const Value& value) const {
  Array<T>& to = cloud.*column;
  if (!to.empty() || cloud.empty() || !any(column)) return;
  if (noted) noted->push_back({k, name});
  to.resize(cloud.size());
  parallel_each(to.size(), kJoinGrain, [&](std::size_t i) { to[i] = static_cast<T>(value(i)); });
}

void CloudJoiner::Impl::fill_columns(std::size_t k, SurfelCloud& cloud) const {
  const auto unknown = [](std::size_t) { return Vec3f(0, 0, 0); };
  const auto zero = [](std::size_t) { return 0; };
  fill(k, cloud, "normal", &SurfelCloud::normal, unknown);
  fill(k, cloud, "shading_normal", &SurfelCloud::shading_normal, unknown);
  // Surfels of clouds without lines are not cut.
  fill(k, cloud, "clip1", &SurfelCloud::clip1, unknown);
  fill(k, cloud, "clip1_d", &SurfelCloud::clip1_distance, zero);
  fill(k, cloud, "clip2", &SurfelCloud::clip2, unknown);
  fill(k, cloud, "clip2_d", &SurfelCloud::clip2_distance, zero);
  // The area comes before the variances, which may become the variances of ellipses.
  fill(k, cloud, "area", &SurfelCloud::area,
       [&](std::size_t i) { return has_variance(cloud) ? root_of_determinant<>(cloud, i) : 0; });
  if (anisotropic()) {
    const auto isotropic = [&](std::size_t i) { return cloud.variance[i]; };
    fill(k, cloud, "tangent", &SurfelCloud::tangent,
         [&](std::size_t i) { return any_tangent(cloud, i); });
    fill(k, cloud, "variance_u", &SurfelCloud::variance_u, isotropic);
    fill(k, cloud, "variance_v", &SurfelCloud::variance_v, isotropic);
  }
  fill(k, cloud, "color", &SurfelCloud::color,
       [](std::size_t) { return SurfelCloud::colorless(); });
  fill(k, cloud, "alpha", &SurfelCloud::alpha, [](std::size_t) { return 1; });
  fill(k, cloud, "coefficient", &SurfelCloud::coefficient, [&](std::size_t i) {
    return cloud.color.empty() ? SurfelCloud::colorless() : cloud.color[i];
  });
  fill(k, cloud, "material", &SurfelCloud::material, zero);
  fill(k, cloud, "level", &SurfelCloud::level, zero);

  const auto keep = [&](auto SurfelCloud::*column) {
    if (!all(column)) cloud.*column = {};
  };
  // Where a cloud has both kinds of variances, the anisotropic ones win.
  keep(&SurfelCloud::variance);
  keep(&SurfelCloud::uv);
  keep(&SurfelCloud::dpdu);
  keep(&SurfelCloud::dpdv);
  keep(&SurfelCloud::group);
  keep(&SurfelCloud::group_radius);
}

/// The numbers of a cloud's scans in the joined cloud.
Array<std::byte> CloudJoiner::Impl::numbered_scans(std::size_t k, const SurfelCloud& cloud,
                                                   ScalarType type) const {
  const std::size_t scans = views_of(heads[k]).size();
  const ExtraProperty* const from =
      heads[k].scan_viewpoints.empty() ? nullptr : find_extra(cloud, "scan");
  const std::size_t bytes = scalar_size(type);
  Array<std::byte> to(cloud.size() * bytes);
  for (std::size_t i = 0; i < cloud.size(); ++i) {
    double own = 0;
    if (from) load_scalars(from->type, from->data.data() + i * scalar_size(from->type), 1, &own);
    if (!(own >= 0 && own < static_cast<double>(scans))) {
      throw_input(names[k],
                  fmt::format("has a surfel of scan {}, and viewpoints of {} scans, which "
                              "are numbered from 0; leave out its column scan",
                              own, scans));
    }
    const std::size_t number = first_scan[k] + static_cast<std::size_t>(own);
    visit_type(type, [&]<class T>(T) {
      const T stored = static_cast<T>(number);
      std::memcpy(to.data() + i * bytes, &stored, bytes);
    });
  }
  return to;
}

void CloudJoiner::Impl::fill_extra(std::size_t k, SurfelCloud& cloud) const {
  std::vector<ExtraProperty> all;
  for (const ExtraProperty& wanted : header.extra) {
    ExtraProperty& to = all.emplace_back(wanted);
    if (!first_scan.empty() && wanted.name == "scan") {
      to.data = numbered_scans(k, cloud, wanted.type);
      continue;
    }
    ExtraProperty* const from = find_extra(cloud, wanted.name);
    if (from && from->type == wanted.type) {
      to.data = std::move(from->data);
      continue;
    }
    const std::size_t bytes = scalar_size(wanted.type);
    to.data.assign(cloud.size() * bytes, std::byte{0});
    if (!from) {
      if (noted) noted->push_back({k, wanted.name});
      continue;
    }
    // Types that differ have become double.
    const std::size_t stride = scalar_size(from->type);
    for (std::size_t i = 0; i < cloud.size(); ++i) {
      double value = 0;
      load_scalars(from->type, from->data.data() + i * stride, 1, &value);
      std::memcpy(to.data.data() + i * bytes, &value, bytes);
    }
  }
  cloud.extra = std::move(all);
}

/// Numbers of its own for every cloud, in the order in which the splats come.
void CloudJoiner::Impl::number_sources(SurfelCloud& cloud) {
  if (!any(&SurfelCloud::source)) return;
  const bool own = cloud.source.empty();
  cloud.source.resize(cloud.size());
  for (std::uint32_t& source : cloud.source) {
    if (own) {
      source = next_source++;
      continue;
    }
    const auto [entry, is_new] = source_number.try_emplace(source, next_source);
    if (is_new) ++next_source;
    source = entry->second;
  }
}

SurfelCloud CloudJoiner::Impl::join(std::size_t k, SurfelCloud cloud) {
  if (k != current) {
    first_row = next_row;
    source_number.clear();
    current = k;
  }
  use_material(k, cloud);
  if (heads.size() == 1) return cloud;
  const bool stepped = cloud.las && header.las && cloud.las->scale == header.las->scale &&
                       cloud.las->offset == header.las->offset;
  if ((cloud.las || header.las) && !stepped) keep_exact(cloud);
  fill_columns(k, cloud);
  fill_extra(k, cloud);
  number_sources(cloud);
  SurfelCloud out = header;
  visit_column_pairs(cloud, out, [](auto& from, auto& to) { to = std::move(from); });
  out.extra = std::move(cloud.extra);
  out.origin = cloud.origin;
  out.decimals = cloud.decimals;
  return out;
}

CloudJoiner::CloudJoiner(std::vector<SurfelCloud> heads, const JoinOptions& options,
                         std::span<const std::string> names)
    : impl_(std::make_unique<Impl>(std::move(heads), options,
                                   std::vector<std::string>(names.begin(), names.end()))) {}
CloudJoiner::~CloudJoiner() = default;

const JoinReport& CloudJoiner::report() const { return impl_->report; }

SurfelCloud CloudJoiner::joined(std::size_t k, SurfelCloud piece) {
  return impl_->join(k, std::move(piece));
}

SurfelCloud CloudJoiner::head(const SurfelCloud& cloud) {
  return cloud.gathered(cloud.empty() ? Array<std::uint32_t>{} : Array<std::uint32_t>{0});
}

namespace {

/// Appends the positions, about an origin for all.
void append_positions(const std::vector<SurfelCloud>& clouds, SurfelCloud& out) {
  Bounds box;
  CoordinateSpread spread;
  for (const SurfelCloud& cloud : clouds) {
    const Bounds b = cloud.bounds();
    if (b.empty()) continue;
    box.add(b.min);
    box.add(b.max);
    spread.add(cloud.origin, cloud.position);
  }
  // Coordinates that are floats are exact about an origin that suits the whole box.
  const bool floats = std::all_of(clouds.begin(), clouds.end(), [](const SurfelCloud& cloud) {
    return !cloud.double_positions && !cloud.decimals && !cloud.las && cloud.exact.empty();
  });
  out.origin = float_origin(floats ? box : spread.core(box));
  const auto for_each = [&](const auto& visit) {
    std::size_t first = 0;
    for (const SurfelCloud& cloud : clouds) {
      const ExactCoordinates exact(cloud);
      parallel_each(cloud.size(), kJoinGrain, [&](std::size_t i) { visit(first + i, exact(i)); });
      first += cloud.size();
    }
  };
  out.exact = {};
  const ExactCoordinates appended(out);
  std::atomic<bool> all_exact = true;
  for_each([&](std::size_t to, const Vec3d& exact) {
    out.position[to] = (exact - out.origin).cast<float>();
    const bool same = (appended(to).array() == exact.array() || exact.array().isNaN()).all();
    if (!same) all_exact = false;
  });
  if (all_exact) return;
  out.exact.resize(out.size());
  for_each([&](std::size_t to, const Vec3d& exact) { out.exact[to] = exact; });
}

/// Clouds with the same columns, one after the other.
SurfelCloud concatenated(std::vector<SurfelCloud> clouds) {
  std::size_t total = 0;
  bool decimals = true;
  SurfelCloud out = CloudJoiner::head(clouds.front());
  for (const SurfelCloud& cloud : clouds) {
    total += cloud.size();
    decimals = decimals && cloud.decimals;
    out.decimals = std::max(out.decimals, cloud.decimals);
  }
  if (!decimals) out.decimals.reset();
  if (total > std::numeric_limits<std::uint32_t>::max()) {
    throw_input("", fmt::format("together there are {} surfels, more than 2^32 - 1", total));
  }
  for (const SurfelCloud& cloud : clouds) {
    visit_column_pairs(cloud, out, [&](const auto& from, auto& to) {
      if (!from.empty()) to.resize(total);
    });
  }
  for (ExtraProperty& property : out.extra) {
    property.data.resize(total * scalar_size(property.type));
  }
  append_positions(clouds, out);
  std::size_t first = 0;
  for (SurfelCloud& cloud : clouds) {
    const std::size_t count = cloud.size();
    // The positions are there already.
    cloud.position = {};
    cloud.exact = {};
    visit_column_pairs(cloud, out, [&](const auto& from, auto& to) {
      std::copy(from.begin(), from.end(), to.begin() + static_cast<std::ptrdiff_t>(first));
    });
    for (std::size_t e = 0; e < out.extra.size(); ++e) {
      const Array<std::byte>& from = cloud.extra[e].data;
      std::copy(from.begin(), from.end(),
                out.extra[e].data.begin() +
                    static_cast<std::ptrdiff_t>(first * scalar_size(out.extra[e].type)));
    }
    first += count;
    cloud = {};
  }
  return out;
}

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
  for (std::size_t k = 0; k < clouds.size(); ++k) clouds[k].check_columns(names[k]);
  std::vector<SurfelCloud> heads;
  for (const SurfelCloud& cloud : clouds) heads.push_back(CloudJoiner::head(cloud));
  CloudJoiner joiner(std::move(heads), options, names);
  if (clouds.empty()) return {};
  for (std::size_t k = 0; k < clouds.size(); ++k) {
    clouds[k] = joiner.joined(k, std::move(clouds[k]));
  }
  if (report) *report = joiner.report();
  return clouds.size() == 1 ? std::move(clouds.front()) : concatenated(std::move(clouds));
}

}  // namespace surfel
