#include <algorithm>
#include <bit>
#include <cstdlib>

#include <surfel/render/shading.h>
#include <surfel/sp06/picture_layers.h>

namespace surfel {
namespace {

/// Place of one of a tile's outermost pixels among them.
std::size_t border_place(int x, int y) {
  x %= kTileSize;
  y %= kTileSize;
  if (y == 0) return static_cast<std::size_t>(x);
  if (y == kTileSize - 1) return static_cast<std::size_t>(kTileSize + x);
  return static_cast<std::size_t>(2 * (kTileSize + y) + (x == 0 ? 0 : 1));
}

/// Whether two normals are of one smooth surface: normals of different surfaces, or of the sides of
/// a crease, differ more.
bool alike(const Vec3f& a, const Vec3f& b) {
  constexpr float kCosine = 0.5F;  // 60 degrees.
  return a.dot(b) > kCosine * a.norm() * b.norm();
}

/// Whether the nearest fragments of two groups differ in their colours alone when shaded, both with
/// the mean normal. Shading is linear in the colour.
bool one_shading(const PictureLayers::GroupPixel& a, const PictureLayers::GroupPixel& b,
                 const Vec3f& mean) {
  const float* const c = a.nearest.channel;
  const float* const e = b.nearest.channel;
  return std::bit_cast<std::uint32_t>(c[kTag]) == std::bit_cast<std::uint32_t>(e[kTag]) &&
         c[kAlpha] == e[kAlpha] && c[kOther] == e[kOther] && alike(Vec3f(c + kNormalX), mean) &&
         alike(Vec3f(e + kNormalX), mean);
}

/// Groups that one_shading() serves, as one: coverages and colours are sums.
PictureLayers::GroupPixel sum_of(std::span<const PictureLayers::GroupPixel> groups) {
  PictureLayers::GroupPixel out = groups.front();
  if (groups.size() == 1) return out;
  constexpr FragmentChannel kMeans[] = {kDepth, kRed, kGreen, kBlue};
  for (const FragmentChannel c : kMeans) out.nearest.channel[c] *= out.coverage;
  for (const PictureLayers::GroupPixel& group : groups.subspan(1)) {
    for (const FragmentChannel c : kMeans) {
      out.nearest.channel[c] += group.coverage * group.nearest.channel[c];
    }
    const auto add = [](Rgba& to, const Rgba& c) {
      to = {to.red + c.red, to.green + c.green, to.blue + c.blue, to.alpha + c.alpha};
    };
    add(out.beneath, group.beneath);
    add(out.beside, group.beside);
    out.coverage += group.coverage;
    out.touched += group.touched;
  }
  for (const FragmentChannel c : kMeans) out.nearest.channel[c] /= out.coverage;
  return out;
}

}  // namespace

void PictureLayers::begin(int width, int height, int groups, bool interpolated) {
  width_ = width;
  height_ = height;
  groups_ = groups;
  interpolated_ = interpolated;
  const std::size_t pixels = index(0, height);
  if (interpolated) surfaces_.resize(pixels);
  nearest_.resize(pixels);
  layers_.resize(pixels);
  borders_.resize(tile(width - 1, height - 1) + 1);
  for (Border& border : borders_) border.groups.clear();
}

bool PictureLayers::at_border(int x, int y) const {
  const auto at_end = [](int at, int size) {
    const int in_tile = at % kTileSize;
    return (in_tile == 0 && at > 0) || (in_tile == kTileSize - 1 && at < size - 1);
  };
  return at_end(x, width_) || at_end(y, height_);
}

std::size_t PictureLayers::tile(int x, int y) const {
  const int tiles_x = (width_ + kTileSize - 1) / kTileSize;
  return static_cast<std::size_t>(y / kTileSize) * tiles_x + x / kTileSize;
}

void PictureLayers::keep(int x, int y, std::span<const GroupPixel> groups) {
  Border& border = borders_[tile(x, y)];
  border.pixels[border_place(x, y)] = {static_cast<std::uint32_t>(border.groups.size()),
                                       static_cast<std::uint32_t>(groups.size())};
  border.groups.insert(border.groups.end(), groups.begin(), groups.end());
}

std::span<const PictureLayers::GroupPixel> PictureLayers::kept(int x, int y) const {
  const Border& border = borders_[tile(x, y)];
  const auto [begin, count] = border.pixels[border_place(x, y)];
  return std::span(border.groups).subspan(begin, count);
}

/// Calls visit(pixel's index, share) for a pixel and the pixels of the picture around it, with the
/// shares of a Gaussian of one pixel's standard deviation.
template <class Visit>
void PictureLayers::for_each_around(int x, int y, const Visit& visit) const {
  constexpr float kShare[] = {1, 0.6065F, 0.3679F};  // At distances of 0, 1 and sqrt 2 pixels.
  for (int row = std::max(0, y - 1); row <= std::min(height_ - 1, y + 1); ++row) {
    for (int column = std::max(0, x - 1); column <= std::min(width_ - 1, x + 1); ++column) {
      visit(index(column, row), kShare[std::abs(row - y) + std::abs(column - x)]);
    }
  }
}

Vec3f PictureLayers::filtered_normal(int x, int y) const {
  const Surface& own = surfaces_[index(x, y)];
  Vec3f sum(0, 0, 0);
  float weights = 0;
  for_each_around(x, y, [&](std::size_t around, float share) {
    const Surface& other = surfaces_[around];
    if (&other != &own && !alike(own.normal, other.normal)) return;
    sum += share * other.normal;
    weights += share * other.weight;
  });
  return own.weight / weights * sum;
}

/// Every pixel's mean counts by the share alone.
PictureLayers::Surface PictureLayers::filtered_nearest(int x, int y) const {
  Surface sum{0, Vec3f(0, 0, 0)};
  for_each_around(x, y, [&](std::size_t around, float share) {
    const Surface& other = nearest_[around];
    if (!(other.weight > 0)) return;
    const float part = share / other.weight;
    sum.weight += part * other.weight;
    sum.normal += part * other.normal;
  });
  return sum;
}

float PictureLayers::filtered_layers(int x, int y) const {
  float layers = 0;
  float shares = 0;
  for_each_around(x, y, [&](std::size_t around, float share) {
    if (!(layers_[around] > 0)) return;
    layers += share * layers_[around];
    shares += share;
  });
  return layers / shares;
}

Fragment PictureLayers::merged(const Shader& shader, int x, int y,
                               std::span<const GroupPixel> groups) const {
  Fragment out{};
  if (groups.empty()) return out;
  Vec3f mean(0, 0, 0);
  float layers = 1;  // Only an environment needs the number.
  if (shader.has_environment()) {
    const Surface sum = filtered_nearest(x, y);
    mean = sum.normal / sum.weight;
    // An environment is seen through the interpolated surface, where there is one.
    layers = interpolated_ ? layers_[index(x, y)] : filtered_layers(x, y);
  }
  const float share = 1.0F / static_cast<float>(groups_);
  Shader::Reflected reflected;
  for (std::size_t begin = 0; begin < groups.size();) {
    std::size_t end = begin + 1;
    while (end < groups.size() && one_shading(groups[begin], groups[end], mean)) ++end;
    const GroupPixel group = sum_of(groups.subspan(begin, end - begin));
    begin = end;
    // The length of the mean normal says how much the surface bends: a flat splat would mirror a
    // single direction, and where that is a lamp's the whole splat would be a speck of light.
    Fragment bent = group.nearest;
    float* const normal = bent.channel + kNormalX;
    if (shader.has_environment() && alike(Vec3f(normal), mean)) {
      std::copy_n(mean.data(), 3, normal);
    }
    const Rgba color = shader.shade(bent, static_cast<float>(x) + 0.5F,
                                    static_cast<float>(y) + 0.5F, 1, reflected);
    const float left = 1 - color.alpha;
    const auto sum = [&](float Rgba::*c) {
      return share * (group.coverage * color.*c + left * group.beneath.*c + group.beside.*c);
    };
    out.channel[kRed] += sum(&Rgba::red);
    out.channel[kGreen] += sum(&Rgba::green);
    out.channel[kBlue] += sum(&Rgba::blue);
    out.channel[kAlpha] += sum(&Rgba::alpha);
    out.channel[kCovered] += share * group.touched;
  }
  out.channel[kWeight] = -layers / out.channel[kCovered];
  out.channel[kTag] = groups.front().nearest.channel[kTag];
  MaterialShares materials;
  for (const GroupPixel& group : groups) {
    materials.add(group.nearest.channel[kTag], group.coverage);
  }
  materials.store(out);
  std::copy_n(mean.data(), 3, out.channel + kNormalX);
  return out;
}

void filter_surfaces(TileABuffer& tile, PictureLayers& picture) {
  const auto for_each_pixel = [&](const auto& visit) {
    for (int pixel = 0; pixel < kTilePixels; ++pixel) {
      const int x = tile_pixel_x(pixel);
      const int y = tile_pixel_y(pixel);
      if (x < tile.width && y < tile.height) visit(pixel, tile.x0 + x, tile.y0 + y);
    }
  };
  for_each_pixel([&](int pixel, int x, int y) {
    const auto normal = [&](int axis) { return tile.at(0, kNormalX + axis, pixel); };
    picture.surface(x, y) = {tile.at(0, kWeight, pixel), Vec3f(normal(0), normal(1), normal(2))};
  });
  for_each_pixel([&](int pixel, int x, int y) {
    if (!(tile.at(0, kWeight, pixel) > 0) || picture.at_border(x, y)) return;
    const Vec3f filtered = picture.filtered_normal(x, y);
    for (int c = 0; c < 3; ++c) tile.at(0, kNormalX + c, pixel) = filtered[c];
  });
}

}  // namespace surfel
