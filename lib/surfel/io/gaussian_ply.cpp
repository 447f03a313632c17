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
#include <surfel/io/gaussian_ply.h>
#include <surfel/io/text_scanner.h>

namespace surfel {
namespace {

constexpr std::string_view kOriginComment = "surfel_origin";
constexpr std::string_view kUpwardComment = "surfel_up";
/// Properties that all trained Gaussians have, beside an opacity or a density.
constexpr const char* kTrainedProperties[] = {"x", "y", "z", "f_dc_0", "scale_0", "rot_0"};

/// A property of all records, and where its values go.
struct Wanted {
  const RecordColumn* column;
  float* first;        ///< Place of the first record's value.
  std::size_t stride;  ///< Places from one record's value to the next.
};

/// Converts one column of the records [begin, end), the first of which is at `records`.
void decode_column(const RecordTable& table, const Wanted& wanted, const std::byte* records,
                   std::size_t begin, std::size_t end) {
  const std::byte* at = records + wanted.column->offset;
  float* to = wanted.first + begin * wanted.stride;
  visit_type(wanted.column->type, [&]<class T>(T) {
    const auto decode = [&](const auto& load) {
      for (std::size_t i = begin; i < end; ++i, at += table.stride, to += wanted.stride) {
        *to = static_cast<float>(load(at));
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

class GaussianPlyReader {
 public:
  explicit GaussianPlyReader(PlyFile& ply) : ply_(ply), table_(ply.scalars("vertex")) {}

  GaussianCloud read() {
    read_tags(ply_.header().comments, ply_.name(), cloud_);
    const std::vector<const RecordColumn*> rest = rest_columns();
    cloud_.degree = degree_of_coefficients(rest.size(), ply_.name());
    filter_ = table_.find("filter_3D");
    const bool density = table_.find("density") != nullptr;
    const bool flat = !table_.find("scale_2");
    if (filter_) {
      cloud_.rule = AmplitudeRule::kCompensated;
      cloud_.trained_with = TrainedWith::kMip;
    }
    if (flat) {
      cloud_.rule = AmplitudeRule::kOpacity;
      cloud_.trained_with = TrainedWith::k2dgs;
    }
    if (density) cloud_.rule = AmplitudeRule::kDensity;
    allocate_gaussians(cloud_, table_.count, ply_.name());
    if (filter_) filter_size_.resize(table_.count);

    want_positions();
    for (int k = 0; k < (flat ? 2 : 3); ++k) {
      want(fmt::format("scale_{}", k), cloud_.scale.data()->data() + k, 3);
    }
    for (std::size_t k = 0; k < 4; ++k) {
      want(fmt::format("rot_{}", k), cloud_.rotation.data()->data() + k, 4);
    }
    want(density ? "density" : "opacity", cloud_.amplitude.data(), 1);
    want_harmonics(rest);
    if (filter_) wanted_.push_back({filter_, filter_size_.data(), 1});

    table_.for_pieces(kGaussianGrain, [&](std::size_t, std::size_t begin, std::size_t end,
                                          const std::byte* records) {
      for (const Wanted& wanted : wanted_) decode_column(table_, wanted, records, begin, end);
      for (std::size_t i = begin; i < end; ++i) activate(i, flat, density);
    });
    finish_gaussians(cloud_, ply_.name());
    return std::move(cloud_);
  }

 private:
  const RecordColumn* column(const std::string& name) const {
    const RecordColumn* const found = table_.find(name);
    if (!found) {
      throw_input(ply_.name(), fmt::format("its Gaussians have no property '{}'", name));
    }
    return found;
  }
  void want(const std::string& name, float* first, std::size_t stride) {
    wanted_.push_back({column(name), first, stride});
  }

  /// Columns of the harmonics above degree 0, which are numbered without a gap.
  std::vector<const RecordColumn*> rest_columns() const {
    std::vector<const RecordColumn*> rest;
    const auto named = [](const RecordColumn& c) { return c.name.starts_with("f_rest_"); };
    const auto count = static_cast<std::size_t>(
        std::count_if(table_.columns.begin(), table_.columns.end(), named));
    // A degree has to fit before the names are searched, one by one.
    degree_of_coefficients(count, ply_.name());
    for (std::size_t k = 0; k < count; ++k) rest.push_back(column(fmt::format("f_rest_{}", k)));
    return rest;
  }

  /// Positions of double precision are offsets from an origin.
  void want_positions() {
    const bool wide = table_.count > 0 && column("x")->type == ScalarType::kFloat64;
    if (!wide) {
      want("x", cloud_.position.data()->data(), 3);
      want("y", cloud_.position.data()->data() + 1, 3);
      want("z", cloud_.position.data()->data() + 2, 3);
      return;
    }
    std::array<Array<double>, 3> world;
    for (std::size_t k = 0; k < 3; ++k) {
      world[k] = ply_.column<double>("vertex", std::string(1, "xyz"[k]));
    }
    Bounds box;
    const auto at = [&](std::size_t i) { return Vec3d(world[0][i], world[1][i], world[2][i]); };
    for (std::size_t i = 0; i < table_.count; ++i) {
      if (at(i).allFinite()) box.add(at(i));
    }
    const Vec3d origin = box.empty() ? Vec3d(0, 0, 0) : float_origin(box);
    for (std::size_t i = 0; i < table_.count; ++i) {
      cloud_.position[i] = (at(i) - origin).cast<float>();
    }
    cloud_.origin += origin;
  }

  /// The file has all coefficients of red before all of green and all of blue, the cloud colours of
  /// one coefficient together.
  void want_harmonics(const std::vector<const RecordColumn*>& rest) {
    const std::size_t stride = cloud_.harmonics_stride();
    const std::size_t coefficients = rest.size() / 3;
    float* const first = cloud_.harmonics.data();
    for (std::size_t color = 0; color < 3; ++color) {
      want(fmt::format("f_dc_{}", color), first + color, stride);
      for (std::size_t k = 0; k < coefficients; ++k) {
        wanted_.push_back({rest[color * coefficients + k], first + 3 * (k + 1) + color, stride});
      }
    }
  }

  /// Makes scales and opacity of the numbers that training optimises.
  void activate(std::size_t i, bool flat, bool density) {
    Vec3f& scale = cloud_.scale[i];
    for (int k = 0; k < (flat ? 2 : 3); ++k) scale[k] = portable::exp(scale[k]);
    if (flat) scale[2] = 0;
    if (!density) cloud_.amplitude[i] = opacity_of_logit(cloud_.amplitude[i]);
    if (filter_) bake_filter(i, filter_size_[i]);
  }

  /// Mip-Splatting's 3D filter: a kernel of variance S becomes one of S + f^2 I, whose opacity
  /// falls by sqrt(|S| / |S + f^2 I|).
  void bake_filter(std::size_t i, float filter) {
    const Vec3d before = cloud_.scale[i].cast<double>().cwiseAbs();
    const double f2 = portable::squared(static_cast<double>(filter));
    const Vec3d after = (before.array().square() + f2).sqrt();
    double ratio = 1;
    for (int k = 0; k < 3; ++k) {
      // Without a filter nothing changes, not even a flat Gaussian.
      if (f2 > 0) ratio *= before[k] / after[k];
    }
    cloud_.scale[i] = after.cast<float>();
    cloud_.amplitude[i] = static_cast<float>(static_cast<double>(cloud_.amplitude[i]) * ratio);
  }

  PlyFile& ply_;
  const RecordTable& table_;
  GaussianCloud cloud_;
  std::vector<Wanted> wanted_;
  const RecordColumn* filter_ = nullptr;
  Array<float> filter_size_;
};

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

std::string ply_header(const GaussianCloud& cloud, const std::vector<std::string>& names,
                       const GaussianWriteOptions& options) {
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
  header += fmt::format("element vertex {}\n", cloud.size());
  for (const std::string& name : names) header += fmt::format("property float {}\n", name);
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

GaussianCloud read_gaussian_ply(PlyFile& ply) { return GaussianPlyReader(ply).read(); }

void write_gaussian_ply(const GaussianCloud& cloud, OutputFile& file,
                        const GaussianWriteOptions& options) {
  const bool flat = cloud.trained_with == TrainedWith::k2dgs &&
                    std::all_of(cloud.scale.begin(), cloud.scale.end(),
                                [](const Vec3f& scale) { return scale[2] == 0; });
  const std::vector<std::string> names = property_names(cloud, flat);
  file.write(ply_header(cloud, names, options));
  const std::uint64_t record = names.size() * sizeof(float);
  const std::uint64_t start = file.reserve(cloud.size() * record);
  parallel_for(cloud.size(), kGaussianGrain, [&](std::size_t begin, std::size_t end, int) {
    static thread_local Array<float> values;
    values.resize((end - begin) * names.size());
    for (std::size_t i = begin; i < end; ++i) {
      encode(cloud, i, flat, values.data() + (i - begin) * names.size());
    }
    file.write_at(start + begin * record, values.data(), values.size() * sizeof(float));
  });
}

}  // namespace surfel
