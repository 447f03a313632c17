// The files of 3D Gaussian splatting (Kerbl et al. 2023), with the third scale left out by 2D
// Gaussian splatting (Huang et al. 2024) and a filter added by Mip-Splatting (Yu et al. 2024).

#include <algorithm>
#include <array>
#include <cmath>
#include <span>

#include <fmt/format.h>
#include <fmt/ranges.h>
#include <surfel/base/bounds.h>
#include <surfel/base/elementary.h>
#include <surfel/base/error.h>
#include <surfel/base/parallel.h>
#include <surfel/base/version.h>
#include <surfel/io/gaussian_columns.h>
#include <surfel/io/gaussian_levels.h>
#include <surfel/io/gaussian_ply.h>
#include <surfel/io/text_scanner.h>
#include <surfel/io/tree_records.h>

namespace surfel {
namespace {

constexpr std::string_view kOriginComment = "surfel_origin";
constexpr std::string_view kUpwardComment = "surfel_up";
/// Element of the Gaussians of coarser levels, coarsest first, with the properties of `vertex`.
constexpr const char* kMergedElement = "surfel_merged";
/// Properties that all trained Gaussians have, beside an opacity or a density.
constexpr const char* kTrainedProperties[] = {"x", "y", "z", "f_dc_0", "scale_0", "rot_0"};

/// A property of all records, and where its values go.
struct Wanted {
  const RecordColumn* column;
  float* first;        ///< Place of the first Gaussian's value.
  std::size_t stride;  ///< Places from one Gaussian's value to the next.
};

/// Converts one column of consecutive records to the values of the Gaussians from `to` on.
void decode_column(const RecordTable& table, const Wanted& wanted, const std::byte* records,
                   std::size_t count, std::size_t to) {
  const std::byte* at = records + wanted.column->offset;
  float* value = wanted.first + to * wanted.stride;
  visit_type(wanted.column->type, [&]<class T>(T) {
    const auto decode = [&](const auto& load) {
      for (std::size_t i = 0; i < count; ++i, at += table.stride, value += wanted.stride) {
        *value = static_cast<float>(load(at));
      }
    };
    if (table.swapped) {
      decode(load_scalar<T, true>);
    } else {
      decode(load_scalar<T, false>);
    }
  });
}

/// What a header's comments tell: how amplitudes are meant, and where the origin is.
void read_tags(const std::vector<std::string>& comments, const std::string& file,
               GaussianCloud& cloud) {
  for (const std::string& comment : comments) {
    TextScanner words(file, comment);
    std::string key(words.word());
    if (key.ends_with(':')) key.pop_back();
    const auto says = [&](AmplitudeRule rule, TrainedWith renderer) {
      cloud.rule = rule;
      cloud.trained_with = renderer;
    };
    // Brush writes the first tag, Postshot the second.
    if (key == "SplatRenderMode") {
      const std::string mode = lower_case(words.word());
      if (mode == "default") says(AmplitudeRule::kOpacity, TrainedWith::kInria);
      if (mode == "mip") says(AmplitudeRule::kCompensated, TrainedWith::kMip);
      if (mode == "2dgs") says(AmplitudeRule::kOpacity, TrainedWith::k2dgs);
    } else if (key == "antialiased") {
      const std::string_view on = words.word();
      if (on == "0") says(AmplitudeRule::kOpacity, TrainedWith::kInria);
      if (on == "1") says(AmplitudeRule::kCompensated, TrainedWith::kMip);
    } else if (key == kOriginComment) {
      for (double& coordinate : cloud.origin) coordinate = words.number("an origin's coordinate");
    } else if (key == kUpwardComment) {
      Vec3d up;
      for (double& coordinate : up)
        coordinate = words.number("a coordinate of the upward direction");
      if (up.norm() > 0) cloud.up = up.normalized();
    }
  }
}

/// Makes Gaussians of records.
class GaussianDecoder {
 public:
  GaussianDecoder(const RecordTable& table, const std::string& file) : table_(table), file_(file) {
    filter_ = table_.find("filter_3D");
    density_ = table_.find("density") != nullptr;
    flat_ = !table_.find("scale_2");
    find_rest();
  }

  /// Sets what the columns tell of all Gaussians.
  void describe(GaussianCloud& cloud) const {
    cloud.degree = degree_of_coefficients(rest_.size(), file_);
    if (filter_) {
      cloud.rule = AmplitudeRule::kCompensated;
      cloud.trained_with = TrainedWith::kMip;
    }
    if (flat_) {
      cloud.rule = AmplitudeRule::kOpacity;
      cloud.trained_with = TrainedWith::k2dgs;
    }
    if (density_) cloud.rule = AmplitudeRule::kDensity;
  }

  /// Are positions of double precision?
  bool wide() const { return table_.count > 0 && column("x")->type == ScalarType::kFloat64; }

  /// Chooses where the Gaussians go: a cloud with columns, which have their final length.
  void into(GaussianCloud& cloud) {
    cloud_ = &cloud;
    wanted_.clear();
    if (!wide()) {
      for (std::size_t k = 0; k < 3; ++k) {
        want(std::string(1, "xyz"[k]), cloud.position.data()->data() + k, 3);
      }
    }
    for (int k = 0; k < (flat_ ? 2 : 3); ++k) {
      want(fmt::format("scale_{}", k), cloud.scale.data()->data() + k, 3);
    }
    for (std::size_t k = 0; k < 4; ++k) {
      want(fmt::format("rot_{}", k), cloud.rotation.data()->data() + k, 4);
    }
    want(density_ ? "density" : "opacity", cloud.amplitude.data(), 1);
    want_harmonics();
  }

  /// Makes Gaussians from number `to` on of consecutive records. Callable from any thread.
  void decode(const std::byte* records, std::size_t count, std::size_t to) const {
    for (const Wanted& wanted : wanted_) decode_column(table_, wanted, records, count, to);
    for (std::size_t i = to; i < to + count; ++i) activate(i);
    if (!filter_) return;
    std::vector<float> filter(count);
    decode_column(table_, {filter_, filter.data(), 1}, records, count, 0);
    for (std::size_t i = 0; i < count; ++i) bake_filter(to + i, filter[i]);
  }

 private:
  const RecordColumn* column(const std::string& name) const {
    const RecordColumn* const found = table_.find(name);
    if (!found) throw_input(file_, fmt::format("its Gaussians have no property '{}'", name));
    return found;
  }
  void want(const std::string& name, float* first, std::size_t stride) {
    wanted_.push_back({column(name), first, stride});
  }

  /// Finds the columns of the harmonics above degree 0, which are numbered without a gap.
  void find_rest() {
    const auto named = [](const RecordColumn& c) { return c.name.starts_with("f_rest_"); };
    const auto count = static_cast<std::size_t>(
        std::count_if(table_.columns.begin(), table_.columns.end(), named));
    // A degree has to fit before the names are searched, one by one.
    degree_of_coefficients(count, file_);
    for (std::size_t k = 0; k < count; ++k) rest_.push_back(column(fmt::format("f_rest_{}", k)));
  }

  /// The file has all coefficients of red before all of green and all of blue, the cloud colours of
  /// one coefficient together.
  void want_harmonics() {
    const std::size_t stride = cloud_->harmonics_stride();
    const std::size_t coefficients = rest_.size() / 3;
    float* const first = cloud_->harmonics.data();
    for (std::size_t color = 0; color < 3; ++color) {
      want(fmt::format("f_dc_{}", color), first + color, stride);
      for (std::size_t k = 0; k < coefficients; ++k) {
        wanted_.push_back({rest_[color * coefficients + k], first + 3 * (k + 1) + color, stride});
      }
    }
  }

  /// Makes scales and opacity of the numbers that training optimises.
  void activate(std::size_t i) const {
    Vec3f& scale = cloud_->scale[i];
    for (int k = 0; k < (flat_ ? 2 : 3); ++k) scale[k] = portable::exp(scale[k]);
    if (flat_) scale[2] = 0;
    if (!density_) cloud_->amplitude[i] = opacity_of_logit(cloud_->amplitude[i]);
  }

  /// Mip-Splatting's 3D filter: a kernel of variance S becomes one of S + f^2 I, whose opacity
  /// falls by sqrt(|S| / |S + f^2 I|).
  void bake_filter(std::size_t i, float filter) const {
    const Vec3d before = cloud_->scale[i].cast<double>().cwiseAbs();
    const double f2 = portable::squared(static_cast<double>(filter));
    const Vec3d after = (before.array().square() + f2).sqrt();
    double ratio = 1;
    for (int k = 0; k < 3; ++k) {
      // Without a filter nothing changes, not even a flat Gaussian.
      if (f2 > 0) ratio *= before[k] / after[k];
    }
    cloud_->scale[i] = after.cast<float>();
    cloud_->amplitude[i] = static_cast<float>(static_cast<double>(cloud_->amplitude[i]) * ratio);
  }

  const RecordTable& table_;
  const std::string& file_;
  const RecordColumn* filter_ = nullptr;
  bool density_ = false;
  bool flat_ = false;
  std::vector<const RecordColumn*> rest_;
  GaussianCloud* cloud_ = nullptr;
  std::vector<Wanted> wanted_;
};

/// Sets positions of double precision: offsets from an origin.
void place_wide(PlyFile& ply, GaussianCloud& cloud) {
  std::array<Array<double>, 3> world;
  for (std::size_t k = 0; k < 3; ++k) {
    world[k] = ply.column<double>("vertex", std::string(1, "xyz"[k]));
  }
  Bounds box;
  const auto at = [&](std::size_t i) { return Vec3d(world[0][i], world[1][i], world[2][i]); };
  for (std::size_t i = 0; i < cloud.size(); ++i) {
    if (at(i).allFinite()) box.add(at(i));
  }
  const Vec3d origin = box.empty() ? Vec3d(0, 0, 0) : float_origin(box);
  for (std::size_t i = 0; i < cloud.size(); ++i) {
    cloud.position[i] = (at(i) - origin).cast<float>();
  }
  cloud.origin += origin;
}

/// The header's lines that say how the amplitudes are meant.
std::string render_mode(const GaussianCloud& cloud) {
  if (cloud.rule == AmplitudeRule::kCompensated) return "comment SplatRenderMode: mip\n";
  if (cloud.trained_with == TrainedWith::kInria) return "comment SplatRenderMode: default\n";
  if (cloud.trained_with == TrainedWith::k2dgs) return "comment SplatRenderMode: 2dgs\n";
  return "";
}

/// The properties of one Gaussian, in the order of the files of 3D Gaussian splatting. Its own
/// viewer expects the normals, which mean nothing.
std::vector<std::string> property_names(const GaussianCloud& cloud, bool flat) {
  std::vector<std::string> names{"x", "y", "z", "nx", "ny", "nz"};
  const auto add = [&](const char* name, std::size_t count) {
    for (std::size_t k = 0; k < count; ++k) names.push_back(fmt::format("{}_{}", name, k));
  };
  add("f_dc", 3);
  add("f_rest", cloud.harmonics_stride() - 3);
  names.emplace_back(cloud.rule == AmplitudeRule::kDensity ? "density" : "opacity");
  add("scale", flat ? 2 : 3);
  add("rot", 4);
  return names;
}

/// \param coarser  Gaussians of coarser levels, which come first in the cloud.
std::string ply_header(const GaussianCloud& cloud, std::size_t coarser,
                       const std::vector<std::string>& names, const GaussianWriteOptions& options) {
  std::string header =
      fmt::format("ply\nformat binary_little_endian 1.0\ncomment surfel {}\n", version());
  header += render_mode(cloud);
  if (!cloud.origin.isZero(0)) {
    header += fmt::format("comment {} {}\n", kOriginComment, fmt::join(cloud.origin, " "));
  }
  if (cloud.up) header += fmt::format("comment {} {}\n", kUpwardComment, fmt::join(*cloud.up, " "));
  for (std::string line : options.provenance) {
    std::replace_if(
        line.begin(), line.end(), [](unsigned char c) { return c < ' '; }, ' ');
    header += fmt::format("comment surfel_provenance {}\n", line);
  }
  std::vector<RecordColumn> columns;
  for (const std::string& name : names) columns.push_back({.name = name});
  header += ply_element("vertex", columns, cloud.size() - coarser);
  if (!cloud.tree.empty()) {
    header += ply_element(kMergedElement, columns, coarser);
    header += ply_element(kTreeElement, tree_columns(), cloud.tree.size());
  }
  return header + "end_header\n";
}

/// Logarithm of a scale, of a flat Gaussian's third one of the least normal number.
float log_of_scale(float scale) {
  return portable::log(std::max(scale, std::numeric_limits<float>::min()));
}

/// Writes the values of Gaussian i, as many as property_names() has.
void encode(const GaussianCloud& cloud, std::size_t i, bool flat, float* to) {
  const auto put = [&](float value) { *to++ = value; };
  for (const float coordinate : cloud.position[i]) put(coordinate);
  for (int k = 0; k < 3; ++k) put(0);
  const std::size_t stride = cloud.harmonics_stride();
  const float* const harmonics = cloud.harmonics.data() + i * stride;
  for (std::size_t color = 0; color < 3; ++color) put(harmonics[color]);
  for (std::size_t color = 0; color < 3; ++color) {
    for (std::size_t k = 3; k < stride; k += 3) put(harmonics[k + color]);
  }
  const bool density = cloud.rule == AmplitudeRule::kDensity;
  put(density ? cloud.amplitude[i] : logit_of_opacity(cloud.amplitude[i]));
  for (int k = 0; k < (flat ? 2 : 3); ++k) put(log_of_scale(cloud.scale[i][k]));
  for (const float component : cloud.rotation[i]) put(component);
}

}  // namespace

bool has_trained_gaussians(const PlyHeader& header) {
  const PlyElement* const vertex = header.find("vertex");
  if (!vertex || !(vertex->find("opacity") || vertex->find("density"))) return false;
  return std::all_of(std::begin(kTrainedProperties), std::end(kTrainedProperties),
                     [&](const char* name) { return vertex->find(name) != nullptr; });
}

GaussianCloud read_gaussian_ply(PlyFile& ply, const GaussianReadOptions& options) {
  GaussianCloud cloud;
  const RecordTable& table = ply.scalars("vertex");
  read_tags(ply.header().comments, ply.name(), cloud);
  GaussianDecoder decoder(table, ply.name());
  decoder.describe(cloud);
  allocate_gaussians(cloud, table.count, ply.name(), options);
  decoder.into(cloud);
  if (decoder.wide()) place_wide(ply, cloud);
  table.for_pieces(kGaussianGrain,
                   [&](std::size_t, std::size_t begin, std::size_t end, const std::byte* records,
                       int) { decoder.decode(records, end - begin, begin); });
  finish_gaussians(cloud, ply.name());
  const PlyElement* const merged = ply.header().find(kMergedElement);
  if (merged) cloud.coarser_skipped = merged->count;
  return cloud;
}

bool has_gaussian_levels(const PlyHeader& header) {
  return has_trained_gaussians(header) && header.find(kMergedElement) && header.find(kTreeElement);
}

GaussianLevels::GaussianLevels(const std::string& path) : GaussianLevels(InputFile(path)) {}

GaussianLevels::GaussianLevels(InputFile file)
    : ply_(std::make_unique<PlyFile>(std::move(file))), head_(std::make_unique<GaussianCloud>()) {
  const std::string& name = ply_->name();
  if (!has_gaussian_levels(ply_->header())) {
    throw_input(name, "has no levels of detail; run surfel-lod on it");
  }
  read_tags(ply_->header().comments, name, *head_);
  const RecordTable& finest = ply_->scalars("vertex");
  const RecordTable& merged = ply_->scalars(kMergedElement);
  const GaussianDecoder decoder(finest, name);
  decoder.describe(*head_);
  GaussianCloud of_merged;
  const GaussianDecoder merged_decoder(merged, name);
  merged_decoder.describe(of_merged);
  if (decoder.wide() || merged_decoder.wide() || of_merged.degree != head_->degree) {
    throw_input(name,
                "its levels of detail are of another kind than its Gaussians; run surfel-lod "
                "again");
  }
  merged_ = merged.count;
  size_ = merged.count + finest.count;
  head_->tree =
      recentered_tree(tree_from_records(ply_->scalars(kTreeElement), size_, name), head_->origin);
  if (head_->tree[first_leaf(head_->tree)].begin != merged_) {
    throw_input(name,
                "its levels of detail are broken: the finest one is not the file's "
                "Gaussians; run surfel-lod again");
  }
}

GaussianLevels::~GaussianLevels() = default;

const GaussianCloud& GaussianLevels::head() const { return *head_; }
const std::string& GaussianLevels::name() const { return ply_->name(); }

GaussianCloud GaussianLevels::read(std::span<const std::uint32_t> clusters) const {
  GaussianCloud cloud = head_->without_gaussians();
  std::vector<std::size_t> first{0};
  for (const std::uint32_t c : clusters) {
    first.push_back(first.back() + head_->tree[c].end - head_->tree[c].begin);
  }
  allocate_gaussians(cloud, first.back(), name());
  if (clusters.empty()) return cloud;
  const RecordTable& finest = ply_->scalars("vertex");
  const RecordTable& merged = ply_->scalars(kMergedElement);
  GaussianDecoder finest_decoder(finest, name());
  GaussianDecoder merged_decoder(merged, name());
  finest_decoder.into(cloud);
  merged_decoder.into(cloud);
  constexpr std::size_t kClusters = 8;
  parallel_for(clusters.size(), kClusters, [&](std::size_t begin, std::size_t end, int) {
    Array<std::byte> scratch;
    for (std::size_t k = begin; k < end; ++k) {
      const TreeCluster& cluster = head_->tree[clusters[k]];
      const bool coarse = cluster.begin < merged_;
      const std::size_t before = coarse ? 0 : merged_;
      const std::byte* const records =
          (coarse ? merged : finest).read(cluster.begin - before, cluster.end - before, scratch);
      (coarse ? merged_decoder : finest_decoder)
          .decode(records, cluster.end - cluster.begin, first[k]);
    }
  });
  finish_gaussians(cloud, name());
  return cloud;
}

void write_gaussian_ply(const GaussianCloud& cloud, OutputFile& file,
                        const GaussianWriteOptions& options) {
  const bool flat = cloud.trained_with == TrainedWith::k2dgs &&
                    std::all_of(cloud.scale.begin(), cloud.scale.end(),
                                [](const Vec3f& scale) { return scale[2] == 0; });
  const std::vector<std::string> names = property_names(cloud, flat);
  const std::size_t coarser = cloud.tree.empty() ? 0 : cloud.tree[first_leaf(cloud.tree)].begin;
  file.write(ply_header(cloud, coarser, names, options));
  const std::uint64_t record = names.size() * sizeof(float);
  const std::uint64_t start = file.reserve(cloud.size() * record);
  parallel_for(cloud.size(), kGaussianGrain, [&](std::size_t begin, std::size_t end, int) {
    static thread_local Array<float> values;
    values.resize((end - begin) * names.size());
    for (std::size_t k = begin; k < end; ++k) {
      // The finest level comes first: what other programs take for the file's Gaussians.
      const std::size_t finest = cloud.size() - coarser;
      const std::size_t i = k < finest ? coarser + k : k - finest;
      encode(cloud, i, flat, values.data() + (k - begin) * names.size());
    }
    file.write_at(start + begin * record, values.data(), values.size() * sizeof(float));
  });
  if (cloud.tree.empty()) return;
  const Array<std::byte> tree = tree_to_records(cloud.tree, cloud.origin);
  file.write(tree.data(), tree.size());
}

}  // namespace surfel
