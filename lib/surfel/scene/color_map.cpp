// S. van der Walt, N. Smith, "A Better Default Colormap for Matplotlib", SciPy 2015 (viridis).
// A. Mikhailov, "Turbo, An Improved Rainbow Colormap for Visualization", Google AI Blog, 2019.
// ASPRS, "LAS Specification 1.4 - R15", 2019, table 17 (point classes).

#include <algorithm>
#include <array>
#include <cmath>
#include <span>

#include <fmt/format.h>
#include <surfel/base/color.h>
#include <surfel/scene/color_map.h>

namespace surfel {
namespace {

using Srgb = std::array<float, 3>;

/// Entries 0, 8, 16, ..., 248 and 255 of 256.
constexpr std::array<Srgb, 33> kViridis{{
    {0.267004F, 0.004874F, 0.329415F}, {0.277018F, 0.050344F, 0.375715F},
    {0.282327F, 0.094955F, 0.417331F}, {0.282884F, 0.13592F, 0.453427F},
    {0.278826F, 0.17549F, 0.483397F},  {0.270595F, 0.214069F, 0.507052F},
    {0.258965F, 0.251537F, 0.524736F}, {0.244972F, 0.287675F, 0.53726F},
    {0.229739F, 0.322361F, 0.545706F}, {0.214298F, 0.355619F, 0.551184F},
    {0.19943F, 0.387607F, 0.554642F},  {0.185556F, 0.41857F, 0.556753F},
    {0.172719F, 0.448791F, 0.557885F}, {0.160665F, 0.47854F, 0.558115F},
    {0.149039F, 0.508051F, 0.55725F},  {0.13777F, 0.537492F, 0.554906F},
    {0.127568F, 0.566949F, 0.550556F}, {0.120565F, 0.596422F, 0.543611F},
    {0.120638F, 0.625828F, 0.533488F}, {0.132268F, 0.655014F, 0.519661F},
    {0.157851F, 0.683765F, 0.501686F}, {0.196571F, 0.711827F, 0.479221F},
    {0.24607F, 0.73891F, 0.452024F},   {0.304148F, 0.764704F, 0.419943F},
    {0.369214F, 0.788888F, 0.382914F}, {0.440137F, 0.811138F, 0.340967F},
    {0.515992F, 0.831158F, 0.294279F}, {0.595839F, 0.848717F, 0.243329F},
    {0.678489F, 0.863742F, 0.189503F}, {0.762373F, 0.876424F, 0.137064F},
    {0.845561F, 0.887322F, 0.099702F}, {0.926106F, 0.89733F, 0.104071F},
    {0.993248F, 0.906157F, 0.143936F},
}};
constexpr std::array<Srgb, 33> kTurbo{{
    {0.18995F, 0.07176F, 0.23217F}, {0.225F, 0.16354F, 0.45096F},   {0.25107F, 0.25237F, 0.63374F},
    {0.26816F, 0.33825F, 0.7805F},  {0.27628F, 0.42118F, 0.89123F}, {0.27543F, 0.50115F, 0.96594F},
    {0.25862F, 0.57958F, 0.99876F}, {0.21382F, 0.65886F, 0.97959F}, {0.15844F, 0.73551F, 0.92305F},
    {0.11167F, 0.80569F, 0.84525F}, {0.09267F, 0.86554F, 0.7623F},  {0.12014F, 0.91193F, 0.6866F},
    {0.19659F, 0.94901F, 0.59466F}, {0.30513F, 0.97697F, 0.48987F}, {0.42778F, 0.99419F, 0.38575F},
    {0.54658F, 0.99907F, 0.29581F}, {0.64362F, 0.98999F, 0.23356F}, {0.72596F, 0.9647F, 0.2064F},
    {0.80473F, 0.92452F, 0.20459F}, {0.8753F, 0.87267F, 0.21555F},  {0.93301F, 0.81236F, 0.22667F},
    {0.97323F, 0.74682F, 0.22536F}, {0.99314F, 0.67408F, 0.20348F}, {0.99593F, 0.58703F, 0.16899F},
    {0.9836F, 0.49291F, 0.12849F},  {0.95801F, 0.39958F, 0.08831F}, {0.92105F, 0.31489F, 0.05475F},
    {0.87422F, 0.24526F, 0.03297F}, {0.81608F, 0.18462F, 0.01809F}, {0.74617F, 0.13098F, 0.00851F},
    {0.66449F, 0.08436F, 0.00424F}, {0.57103F, 0.04474F, 0.00529F}, {0.4796F, 0.01583F, 0.01055F},
}};
constexpr std::array<Srgb, 5> kTerrain{{
    {0.118F, 0.369F, 0.259F},
    {0.361F, 0.573F, 0.314F},
    {0.655F, 0.665F, 0.361F},
    {0.808F, 0.705F, 0.5F},
    {0.98F, 0.973F, 0.957F},
}};
constexpr std::array<Srgb, 2> kGrey{{{0.0F, 0.0F, 0.0F}, {1.0F, 1.0F, 1.0F}}};

/// Knots of a map, at 0, 1, 2, ... but for the last, which is at `end`.
struct Knots {
  std::span<const Srgb> value;
  double end;

  std::size_t last() const { return value.size() - 1; }
  double place(std::size_t i) const { return i == last() ? end : static_cast<double>(i); }
  double slope(std::size_t a, std::size_t b, std::size_t channel) const {
    return (value[b][channel] - value[a][channel]) / (place(b) - place(a));
  }
  /// Derivative at a knot: of the chord between its neighbours; at the ends of the parabola that
  /// the inner derivative leaves.
  double derivative(std::size_t i, std::size_t channel) const {
    if (last() == 1) return slope(0, 1, channel);
    if (i == 0) return 1.5 * slope(0, 1, channel) - derivative(1, channel) / 2;
    if (i == last()) return 1.5 * slope(i - 1, i, channel) - derivative(i - 1, channel) / 2;
    return slope(i - 1, i + 1, channel);
  }
  double at(double x, std::size_t channel) const {
    const std::size_t k = std::min(static_cast<std::size_t>(x), last() - 1);
    const double h = place(k + 1) - place(k);
    const double u = (x - place(k)) / h;
    const double p = value[k][channel];
    const double rise = value[k + 1][channel] - p;
    const double d = h * derivative(k, channel);
    const double e = h * derivative(k + 1, channel);
    return p + u * (d + u * (3 * rise - 2 * d - e + u * (d + e - 2 * rise)));
  }
};

Knots knots(ColorMap map) {
  constexpr double kEighths = 255.0 / 8;
  switch (map) {
    case ColorMap::kViridis:
      return {kViridis, kEighths};
    case ColorMap::kTurbo:
      return {kTurbo, kEighths};
    case ColorMap::kTerrain:
      return {kTerrain, 4};
    case ColorMap::kGrey:
      break;
  }
  return {kGrey, 1};
}

Vec3f from_srgb(double red, double green, double blue) {
  const auto linear = [](double code) {
    return srgb_to_linear(static_cast<float>(std::clamp(code, 0.0, 1.0)));
  };
  return {linear(red), linear(green), linear(blue)};
}

struct LasClass {
  const char* name;
  std::array<std::uint8_t, 3> srgb;
};
constexpr std::array<LasClass, 19> kLasClasses{{
    {"never classified", {150, 150, 150}},
    {"unclassified", {190, 190, 190}},
    {"ground", {166, 116, 70}},
    {"low vegetation", {176, 214, 98}},
    {"medium vegetation", {98, 178, 72}},
    {"high vegetation", {32, 112, 54}},
    {"building", {214, 84, 62}},
    {"low point (noise)", {232, 60, 200}},
    {"model key point", {238, 190, 60}},
    {"water", {58, 122, 206}},
    {"rail", {110, 84, 150}},
    {"road surface", {92, 96, 106}},
    {"overlap", {222, 206, 180}},
    {"wire - guard", {250, 226, 100}},
    {"wire - conductor", {255, 160, 40}},
    {"transmission tower", {128, 44, 44}},
    {"wire connector", {196, 132, 178}},
    {"bridge deck", {126, 206, 206}},
    {"high noise", {150, 40, 190}},
}};

bool known_class(std::int64_t number) {
  return number >= 0 && number < static_cast<std::int64_t>(kLasClasses.size());
}

}  // namespace

const std::string& color_map_name(ColorMap map) {
  static const std::array<std::string, 4> kNames{"viridis", "turbo", "terrain", "grey"};
  return kNames[static_cast<std::size_t>(map)];
}

Vec3f map_color(ColorMap map, double t) {
  const Knots curve = knots(map);
  const double x = std::clamp(t, 0.0, 1.0) * curve.end;
  return from_srgb(curve.at(x, 0), curve.at(x, 1), curve.at(x, 2));
}

ColorTable::ColorTable(ColorMap map) {
  constexpr std::size_t kSteps = 4096;
  color_.reserve(kSteps + 1);
  for (std::size_t i = 0; i <= kSteps; ++i) {
    color_.push_back(map_color(map, static_cast<double>(i) / kSteps));
  }
}

Vec3f ColorTable::operator()(double t) const {
  const double x = std::clamp(t, 0.0, 1.0) * static_cast<double>(color_.size() - 1);
  const std::size_t k = std::min(static_cast<std::size_t>(x), color_.size() - 2);
  const auto u = static_cast<float>(x - static_cast<double>(k));
  return color_[k] + u * (color_[k + 1] - color_[k]);
}

Vec3f category_color(std::int64_t category) {
  // Steps of the golden section spread hues evenly, however many there are; lightness changes with
  // a period of three besides, since neighbours in hue are five or eight numbers apart.
  constexpr double kGolden = 0.6180339887498949;
  constexpr std::array<double, 3> kLightest{0.9, 0.68, 0.98};
  constexpr std::array<double, 3> kDarkest{0.25, 0.16, 0.5};
  const double turns = kGolden * static_cast<double>(category);
  const double hue = 6 * (turns - std::floor(turns));
  const auto kind = static_cast<std::size_t>((category % 3 + 3) % 3);
  const auto channel = [&](double middle) {
    const double away = std::abs(std::remainder(hue - middle, 6.0));
    return kDarkest[kind] + (kLightest[kind] - kDarkest[kind]) * std::clamp(2 - away, 0.0, 1.0);
  };
  return from_srgb(channel(0), channel(2), channel(4));
}

Vec3f las_class_color(std::int64_t number) {
  if (!known_class(number)) return category_color(number);
  const auto& [red, green, blue] = kLasClasses[static_cast<std::size_t>(number)].srgb;
  return {srgb8_to_linear(red), srgb8_to_linear(green), srgb8_to_linear(blue)};
}

std::string las_class_name(std::int64_t number) {
  if (!known_class(number)) return fmt::to_string(number);
  return fmt::format("{} {}", number, kLasClasses[static_cast<std::size_t>(number)].name);
}

}  // namespace surfel
