#include <algorithm>
#include <array>
#include <cctype>
#include <cmath>
#include <iterator>
#include <limits>
#include <numbers>
#include <string_view>
#include <utility>

#include <fmt/format.h>
#include <fmt/ranges.h>
#include <surfel/base/coordinate_spread.h>
#include <surfel/base/error.h>
#include <surfel/base/nearest_name.h>
#include <surfel/base/parallel.h>
#include <surfel/base/random.h>
#include <surfel/scene/surfel_variance.h>
#include <surfel/store/attribute_values.h>
#include <surfel/store/render_cloud.h>

namespace surfel {
namespace {

constexpr double kNone = std::numeric_limits<double>::quiet_NaN();

/// Values that percentiles are taken of, roughly.
constexpr std::size_t kSampled = std::size_t{1} << 20;

/// A name in lower case, without the prefix of CloudCompare's scalar fields.
std::string plain_name(const std::string& name) {
  std::string plain = name;
  for (char& c : plain) c = static_cast<char>(std::tolower(static_cast<unsigned char>(c)));
  constexpr std::string_view kPrefix = "scalar_";
  return plain.starts_with(kPrefix) ? plain.substr(kPrefix.size()) : plain;
}

bool one_of(const std::string& name, std::initializer_list<const char*> names) {
  return std::find(names.begin(), names.end(), name) != names.end();
}

bool is_las_class(const std::string& plain) { return one_of(plain, {"classification", "class"}); }

bool names_category(const std::string& plain) {
  return one_of(plain, {"group", "material", "level", "label", "labels", "category", "segment",
                        "cluster", "object", "instance", "flag", "ring", "source"});
}

/// Columns that may stand for a name, best first.
std::vector<std::string> spellings(const std::string& plain) {
  if (plain == "intensity") return {plain, "reflectance", "reflectivity", "remission"};
  if (plain == "classification") return {plain, "class", "label"};
  return {plain};
}

/// The value of rank floor(share (n - 1) + 1/2). Changes the order of the values.
double percentile(std::vector<double>& values, double share) {
  const auto rank =
      static_cast<std::ptrdiff_t>(share * static_cast<double>(values.size() - 1) + 0.5);
  std::nth_element(values.begin(), values.begin() + rank, values.end());
  return values[static_cast<std::size_t>(rank)];
}

bool is_category(AttributeKind kind) {
  return kind == AttributeKind::kCategory || kind == AttributeKind::kLasClass;
}

/// Is this a value of an attribute of such a kind?
bool has_value(double value, AttributeKind kind) {
  return std::isfinite(value) &&
         (!is_category(kind) || (std::abs(value) < 0x1p62 && value == std::floor(value)));
}

/// Values of a range of surfels.
struct Part {
  std::size_t count = 0, missing = 0;
  double min = std::numeric_limits<double>::infinity();
  double max = -std::numeric_limits<double>::infinity();
  std::map<std::int64_t, std::size_t> categories;
  std::vector<double> sample;
  std::vector<Vec3f> places;  ///< Of the sample, relative to AttributeSurvey::Impl::origin.

  void add_category(std::int64_t number, std::size_t surfels) {
    categories[number] += surfels;
    if (categories.size() > AttributeSummary::kMostCategories) {
      categories.erase(std::prev(categories.end()));
    }
  }
  void add(double value, AttributeKind kind, bool chosen, const Vec3f& place) {
    if (std::isnan(value)) {
      ++missing;
      return;
    }
    ++count;
    min = std::min(min, value);
    max = std::max(max, value);
    if (is_category(kind)) add_category(static_cast<std::int64_t>(value), 1);
    if (!chosen) return;
    sample.push_back(value);
    places.push_back(place);
  }
  void add(const Part& part) {
    count += part.count;
    missing += part.missing;
    min = std::min(min, part.min);
    max = std::max(max, part.max);
    for (const auto& [number, surfels] : part.categories) add_category(number, surfels);
    sample.insert(sample.end(), part.sample.begin(), part.sample.end());
    places.insert(places.end(), part.places.begin(), part.places.end());
  }
};

/// \param spread  of all places
AttributeSummary summed_up(Part all, const CoordinateSpread& spread) {
  AttributeSummary summary;
  summary.count = all.count;
  summary.missing = all.missing;
  summary.categories = std::move(all.categories);
  if (all.count == 0) return summary;
  summary.min = all.min;
  summary.max = all.max;
  // Where few of very many surfels have a value, none may have been chosen.
  if (all.sample.empty()) all.sample = {all.min, all.max};
  const Bounds box = spread.box();
  const Bounds core = spread.core(box);
  std::vector<double> within;
  if (core.diagonal() < box.diagonal()) {
    for (std::size_t i = 0; i < all.places.size(); ++i) {
      if (core.contains(all.places[i].cast<double>())) within.push_back(all.sample[i]);
    }
  }
  summary.percentile_1 = percentile(all.sample, 0.01);
  summary.median = percentile(all.sample, 0.5);
  summary.percentile_99 = percentile(all.sample, 0.99);
  summary.core = {summary.percentile_1, summary.percentile_99};
  if (!within.empty()) summary.core = {percentile(within, 0.01), percentile(within, 0.99)};
  return summary;
}

}  // namespace

std::pair<double, double> AttributeSummary::robust_range() const {
  return core.first < core.second ? core : std::pair(min, max);
}

std::vector<std::string> AttributeValues::names(const SurfelSource& source) {
  std::vector<std::string> names{"elevation", "x", "y", "z"};
  if (source.attributes().normal) names.emplace_back("normal");
  names.insert(names.end(), {"radius", "spacing", "density"});
  for (const std::string& column : source.columns()) {
    if (std::find(names.begin(), names.end(), column) == names.end()) names.push_back(column);
  }
  return names;
}

std::optional<std::string> AttributeValues::find(const SurfelSource& source,
                                                 const std::string& name) {
  const std::vector<std::string> known = names(source);
  if (std::find(known.begin(), known.end(), name) != known.end()) return name;
  for (const std::string& spelling : spellings(plain_name(name))) {
    for (const std::string& column : known) {
      if (plain_name(column) == spelling) return column;
    }
  }
  return std::nullopt;
}

bool AttributeValues::of_size(const std::string& name) {
  return one_of(plain_name(name), {"radius", "spacing", "density"});
}

AttributeValues::AttributeValues(const SurfelSource& source, const std::string& name,
                                 const Vec3d& up, const std::string& file)
    : source_(source) {
  const std::optional<std::string> found = find(source, name);
  if (!found) {
    const std::vector<std::string> known = names(source);
    throw_input(file, fmt::format("there is no attribute \"{}\" to colour by{}; there are {}", name,
                                  did_you_mean(name, known), fmt::join(known, ", ")));
  }
  name_ = *found;
  // A file's own column of a name wins over what the library would compute.
  const std::vector<std::string> columns = source.columns();
  const auto column = std::find(columns.begin(), columns.end(), name_);
  constexpr std::array<const char*, 3> kAxes{"x", "y", "z"};
  const auto axis = std::find(kAxes.begin(), kAxes.end(), name_) - kAxes.begin();
  if (column != columns.end()) {
    column_ = static_cast<std::size_t>(column - columns.begin());
    const std::string plain = plain_name(name_);
    if (names_category(plain)) kind_ = AttributeKind::kCategory;
    if (is_las_class(plain)) kind_ = AttributeKind::kLasClass;
  } else if (axis < 3 || name_ == "elevation") {
    origin_ = Origin::kPosition;
    along_ = axis < 3 ? Vec3d(Vec3d::Unit(axis)) : Vec3d(up.normalized());
  } else if (name_ == "normal") {
    origin_ = Origin::kNormal;
    kind_ = AttributeKind::kNormal;
  } else if (name_ == "radius") {
    origin_ = Origin::kRadius;
  } else if (name_ == "spacing") {
    origin_ = Origin::kSpacing;
  } else {
    origin_ = Origin::kDensity;
  }
}

void AttributeValues::values(std::size_t begin, std::size_t end, const RenderCloud& rows,
                             std::size_t row, double* to) const {
  const std::size_t count = end - begin;
  const auto each = [&](auto&& value) {
    for (std::size_t i = 0; i < count; ++i) to[i] = value(row + i);
  };
  switch (origin_) {
    case Origin::kPosition: {
      const double offset = along_.dot(source_.origin());
      each([&](std::size_t i) {
        return offset + along_.dot(Vec3d(rows.x[i], rows.y[i], rows.z[i]));
      });
      break;
    }
    case Origin::kNormal:
      break;
    case Origin::kRadius:
      each([&](std::size_t i) { return std::numbers::sqrt2 * rows.larger_deviation(i); });
      break;
    case Origin::kSpacing:
      each([&](std::size_t i) { return std::sqrt(static_cast<double>(rows.area[i])); });
      break;
    case Origin::kDensity:
      each([&](std::size_t i) { return 1 / static_cast<double>(rows.area[i]); });
      break;
    case Origin::kColumn:
      source_.fill_column(column_, begin, end, to);
      break;
  }
  for (std::size_t i = 0; i < count; ++i) {
    if (!has_value(to[i], kind_)) to[i] = kNone;
  }
}

AttributeSummary AttributeValues::summary(std::size_t begin, std::size_t end) const {
  AttributeSurvey survey(end - begin);
  survey.add(*this, begin, end);
  return survey.summary();
}

struct AttributeSurvey::Impl {
  double chosen;          ///< Share of the surfels that percentiles are taken of.
  std::size_t added = 0;  ///< Surfels.
  Part all;
  std::optional<Vec3d> origin;  ///< Of the first surfels that were added.
  CoordinateSpread spread;
};

AttributeSurvey::AttributeSurvey(std::size_t total) : impl_(std::make_unique<Impl>()) {
  impl_->chosen = static_cast<double>(kSampled) / static_cast<double>(std::max(total, kSampled));
  // About as many are chosen; a vector that grows would take twice as much.
  const std::size_t reserved = std::min(total, kSampled + kSampled / 64);
  impl_->all.sample.reserve(reserved);
  impl_->all.places.reserve(reserved);
}
AttributeSurvey::~AttributeSurvey() = default;
AttributeSurvey::AttributeSurvey(AttributeSurvey&&) noexcept = default;

void AttributeSurvey::add(const AttributeValues& values, std::size_t begin, std::size_t end) {
  values.add_to(*this, begin, end);
}

void AttributeValues::add_to(AttributeSurvey& to, std::size_t begin, std::size_t end) const {
  AttributeSurvey::Impl& survey = *to.impl_;
  const std::size_t total = end - begin;
  if (!survey.origin) survey.origin = source_.origin();
  const Vec3f shift = (source_.origin() - *survey.origin).cast<float>();
  std::vector<Part> parts((total + RenderCloud::kBlock - 1) / RenderCloud::kBlock);
  struct Worker {
    RenderCloud rows;
    std::vector<double> value = std::vector<double>(RenderCloud::kBlock);
    std::vector<Vec3f> places = {};
    CoordinateSpread spread = {};
  };
  PerWorker<Worker> workers;
  parallel_for(total, RenderCloud::kBlock, [&](std::size_t first, std::size_t last, int w) {
    auto& [rows, value, places, spread] = workers[w];
    if (rows.x.empty()) rows.allocate(RenderCloud::kBlock, source_.attributes(), {}, "");
    source_.fill(begin + first, begin + last, rows, 0);
    values(begin + first, begin + last, rows, 0, value.data());
    Part& part = parts[first / RenderCloud::kBlock];
    UnusableSurfels ignored;
    places.clear();
    for (std::size_t i = 0; i < last - first; ++i) {
      if (!rows.usable(i, ignored)) continue;
      places.push_back(Vec3f(rows.x[i], rows.y[i], rows.z[i]) + shift);
      part.add(value[i], kind_, random_uniform(0, survey.added + first + i) < survey.chosen,
               places.back());
    }
    spread.add(Vec3d::Zero(), places);
  });
  workers.for_each([&](const Worker& worker) { survey.spread.add(worker.spread); });
  for (const Part& part : parts) survey.all.add(part);
  survey.added += total;
}

AttributeSummary AttributeSurvey::summary() {
  return summed_up(std::move(impl_->all), impl_->spread);
}

std::vector<std::string> measured_attributes(const SurfelCloud& cloud) {
  const CloudSource source(cloud, "", CloudSource::Sizes::kAny);
  std::vector<std::string> names = AttributeValues::names(source);
  std::erase_if(names, [&](const std::string& name) {
    if (AttributeValues::of_size(name) && !has_variance(cloud)) return true;
    return AttributeValues(source, name, Vec3d::UnitZ(), "").kind() == AttributeKind::kNormal;
  });
  return names;
}

std::vector<std::pair<std::string, AttributeSummary>> summarize_attributes(const SurfelCloud& cloud,
                                                                           const Vec3d& up) {
  const CloudSource source(cloud, "", CloudSource::Sizes::kAny);
  std::vector<std::pair<std::string, AttributeSummary>> all;
  for (const std::string& name : measured_attributes(cloud)) {
    all.emplace_back(name, AttributeValues(source, name, up, "").summary(0, source.size()));
  }
  return all;
}

}  // namespace surfel
