// The particle fields of OpenUSD 26.03 (usdVol/schema.usda): scales and opacities are linear, the
// coefficients of each colour lie together, quaternions begin with their real part.

#include <algorithm>
#include <string_view>
#include <utility>

#include <surfel/base/bounds.h>
#include <surfel/base/version.h>
#include <surfel/io/gaussian_usda.h>
#include <surfel/io/record_writer.h>

namespace surfel {
namespace {

/// Reach of Gaussians, in standard deviations, for the box that programs cull by.
constexpr double kReach = 3;

constexpr std::string_view kApis[] = {
    "ParticleFieldPositionAttributeAPI", "ParticleFieldOrientationAttributeAPI",
    "ParticleFieldScaleAttributeAPI", "ParticleFieldOpacityAttributeAPI",
    "ParticleFieldSphericalHarmonicsAttributeAPI"};

class UsdaText {
 public:
  explicit UsdaText(OutputFile& file) : out_(file) {}

  void line(std::string_view text) {
    out_.add_text(text);
    out_.end_line();
  }
  /// A tuple of numbers.
  template <class Tuple>
  void tuple(const Tuple& values) {
    out_.add_text('(');
    bool first = true;
    for (const auto value : values) {
      if (!std::exchange(first, false)) out_.add_text(", ");
      out_.add_number(value);
    }
    out_.add_text(')');
  }
  void number(float value) { out_.add_number(value); }
  void text(std::string_view text) { out_.add_text(text); }

  /// An attribute that is an array: write(i) writes one of its `count` values.
  template <class Write>
  void array(std::string_view declaration, std::size_t count, const Write& write) {
    out_.add_text("    ");
    out_.add_text(declaration);
    out_.add_text(" = [");
    for (std::size_t i = 0; i < count; ++i) {
      if (i > 0) out_.add_text(", ");
      write(i);
      out_.end_record();
    }
    line("]");
  }
  void finish() { out_.flush(); }

 private:
  RecordWriter out_;
};

/// Are all Gaussians flat?
bool are_surflets(const GaussianCloud& cloud) {
  return std::all_of(cloud.scale.begin(), cloud.scale.end(),
                     [](const Vec3f& scale) { return scale[2] == 0; });
}

/// The box of all Gaussians as far as they reach, relative to the cloud's origin.
Bounds reach_of(const GaussianCloud& cloud) {
  Bounds box;
  for (std::size_t i = 0; i < cloud.size(); ++i) {
    const Vec3d center = cloud.position[i].cast<double>();
    const Vec3d reach = Vec3d::Constant(kReach * static_cast<double>(cloud.scale[i].maxCoeff()));
    box.add(center - reach);
    box.add(center + reach);
  }
  return box;
}

/// USD's stages have y or z upwards; what lies otherwise is turned.
struct UpAxis {
  std::string_view name = "Y";
  std::string_view turn;  ///< Turned about x by so many degrees; empty: not at all.
};

UpAxis up_axis(const GaussianCloud& cloud) {
  if (!cloud.up) return {};
  Eigen::Index axis = 0;
  cloud.up->cwiseAbs().maxCoeff(&axis);
  const bool down = (*cloud.up)[axis] < 0;
  if (axis == 2) return {"Z", down ? "180" : ""};
  return {"Y", down ? "180" : ""};
}

}  // namespace

void write_gaussian_usda(const GaussianCloud& cloud, OutputFile& file,
                         const GaussianWriteOptions& options) {
  const bool surflets = are_surflets(cloud);
  const UpAxis up = up_axis(cloud);
  UsdaText out(file);
  out.line("#usda 1.0");
  out.line("(");
  out.line("    defaultPrim = \"Gaussians\"");
  std::string made = std::string("surfel ") + version();
  for (const std::string& line : options.provenance) made += "; " + line;
  std::replace_if(
      made.begin(), made.end(), [](unsigned char c) { return c < ' ' || c == '"' || c == '\\'; },
      ' ');
  out.line("    doc = \"" + made + "\"");
  out.line("    upAxis = \"" + std::string(up.name) + "\"");
  out.line(")");
  out.line("");
  out.line("def ParticleField \"Gaussians\" (");
  out.text("    prepend apiSchemas = [");
  for (const std::string_view api : kApis) {
    out.text("\"");
    out.text(api);
    out.text("\", ");
  }
  out.line(surflets ? "\"ParticleFieldKernelGaussianSurfletAPI\"]"
                    : "\"ParticleFieldKernelGaussianEllipsoidAPI\"]");
  out.line(")");
  out.line("{");
  const Bounds box = reach_of(cloud);
  const Vec3f corners[] = {box.min.cast<float>(), box.max.cast<float>()};
  out.array("float3[] extent", 2, [&](std::size_t i) { out.tuple(corners[i]); });
  out.array("point3f[] positions", cloud.size(),
            [&](std::size_t i) { out.tuple(cloud.position[i]); });
  out.array("quatf[] orientations", cloud.size(),
            [&](std::size_t i) { out.tuple(cloud.rotation[i]); });
  out.array("float3[] scales", cloud.size(), [&](std::size_t i) {
    // A surflet's third scale has no effect; 1 keeps transforms invertible.
    const Vec3f& s = cloud.scale[i];
    out.tuple(surflets ? Vec3f(s[0], s[1], 1) : s);
  });
  out.array("float[] opacities", cloud.size(),
            [&](std::size_t i) { out.number(cloud.amplitude[i]); });
  out.line("    uniform int radiance:sphericalHarmonicsDegree = " + std::to_string(cloud.degree));
  out.array("float3[] radiance:sphericalHarmonicsCoefficients", cloud.harmonics.size() / 3,
            [&](std::size_t i) { out.tuple(Vec3f(cloud.harmonics.data() + 3 * i)); });
  const bool moved = !cloud.origin.isZero(0);
  if (moved) {
    out.text("    double3 xformOp:translate = ");
    out.tuple(cloud.origin);
    out.line("");
  }
  if (!up.turn.empty()) {
    out.line("    float xformOp:rotateX = " + std::string(up.turn));
  }
  if (moved || !up.turn.empty()) {
    out.text("    uniform token[] xformOpOrder = [");
    if (!up.turn.empty()) out.text("\"xformOp:rotateX\"");
    if (!up.turn.empty() && moved) out.text(", ");
    if (moved) out.text("\"xformOp:translate\"");
    out.line("]");
  }
  out.line("}");
  out.finish();
}

}  // namespace surfel
