#include <algorithm>
#include <array>
#include <cmath>
#include <functional>
#include <span>
#include <string>
#include <utility>

#include <fmt/format.h>
#include <surfel/base/color.h>
#include <surfel/base/error.h>
#include <surfel/render/contact_sheet.h>
#include <surfel/scene/color_map.h>
#include <surfel/scene/glyphs.h>
#include <surfel/store/render_cloud.h>

namespace surfel {
namespace {

constexpr int kPanelsAcross = 3;
constexpr int kPanelsDown = 2;

/// A channel of a picture.
class SheetChannel {
 public:
  SheetChannel(const Image& image, const char* name) : image_(image) {
    const auto found = std::find(image.channels.begin(), image.channels.end(), name);
    if (found == image.channels.end()) {
      throw_usage(fmt::format("the picture has no channel {} for a contact sheet", name));
    }
    channel_ = static_cast<std::size_t>(found - image.channels.begin());
  }
  float operator()(std::size_t pixel) const {
    return image_.data[pixel * image_.channels.size() + channel_];
  }

 private:
  const Image& image_;
  std::size_t channel_;
};

/// The value that a share of the values stays below; 0 of none. Reorders them.
float share_below(std::vector<float>& values, double share) {
  if (values.empty()) return 0;
  const auto at =
      values.begin() + static_cast<std::ptrdiff_t>(share * static_cast<double>(values.size() - 1));
  std::nth_element(values.begin(), at, values.end());
  return *at;
}

/// Which pixels are open and do not reach the picture's border through open ones.
std::vector<bool> enclosed(const std::vector<bool>& open, int width, int height) {
  std::vector<bool> hole = open;
  std::vector<std::size_t> next;
  const auto index = [&](int x, int y) {
    return static_cast<std::size_t>(y) * static_cast<std::size_t>(width) +
           static_cast<std::size_t>(x);
  };
  const auto reach = [&](int x, int y) {
    if (x < 0 || y < 0 || x >= width || y >= height || !hole[index(x, y)]) return;
    hole[index(x, y)] = false;
    next.push_back(index(x, y));
  };
  for (int x = 0; x < width; ++x) {
    reach(x, 0);
    reach(x, height - 1);
  }
  for (int y = 0; y < height; ++y) {
    reach(0, y);
    reach(width - 1, y);
  }
  while (!next.empty()) {
    const std::size_t pixel = next.back();
    next.pop_back();
    const int x = static_cast<int>(pixel % static_cast<std::size_t>(width));
    const int y = static_cast<int>(pixel / static_cast<std::size_t>(width));
    reach(x - 1, y);
    reach(x + 1, y);
    reach(x, y - 1);
    reach(x, y + 1);
  }
  return hole;
}

/// The sheet, panel by panel.
class Sheet {
 public:
  Sheet(const Image& picture, const Vec3f& background)
      : width_(picture.width), height_(picture.height), background_(background) {
    if (kPanelsAcross * width_ > Camera::kMostSide || kPanelsDown * height_ > Camera::kMostSide) {
      throw_usage(
          fmt::format("a contact sheet of pictures of {}x{} pixels is too large; make the "
                      "picture smaller",
                      width_, height_));
    }
    image_ = rgba_image(kPanelsAcross * width_, kPanelsDown * height_);
  }

  /// Adds a panel: color(pixel) over the background, by the share cover(pixel).
  void add(const std::string& title, const std::function<Vec3f(std::size_t)>& color,
           const std::function<float(std::size_t)>& cover) {
    const int left = width_ * (panel_ % kPanelsAcross);
    const int top = height_ * (panel_ / kPanelsAcross);
    ++panel_;
    for (int y = 0; y < height_; ++y) {
      for (int x = 0; x < width_; ++x) {
        const std::size_t i = static_cast<std::size_t>(y) * static_cast<std::size_t>(width_) +
                              static_cast<std::size_t>(x);
        float* to = image_.pixel(left + x, top + y);
        const Vec3f c = color(i) + (1 - cover(i)) * background_;
        std::copy(c.data(), c.data() + 3, to);
        to[3] = 1;
      }
    }
    add_title(title, left, top);
  }

  Image take() { return std::move(image_); }

 private:
  void add_title(const std::string& title, int left, int top) {
    const double wanted = std::max(7.0, 0.03 * std::min(width_, height_));
    const double capital = std::min(wanted, 0.9 * width_ / (text_width(title) + 1));
    const int box_width = static_cast<int>((text_width(title) + 1) * capital);
    const int box_height = static_cast<int>(2 * capital);
    for (int y = 0; y < std::min(box_height, height_); ++y) {
      for (int x = 0; x < std::min(box_width, width_); ++x) {
        blend_over(image_.pixel(left + x, top + y), Vec3f(1, 1, 1), 0.78);
      }
    }
    draw_text(image_, title, left + 0.5 * capital, top + 1.5 * capital, capital,
              Vec3f(0.012F, 0.012F, 0.012F));
  }

  int width_;
  int height_;
  Vec3f background_;
  Image image_;
  int panel_ = 0;
};

}  // namespace

std::vector<float> surfels_per_pixel(ClusterStore& store, const Camera& camera) {
  std::vector<float> count(
      static_cast<std::size_t>(camera.width) * static_cast<std::size_t>(camera.height), 0.0F);
  const RenderCloud& cloud = store.cloud();
  std::vector<VisibleCluster> wanted;
  for (std::uint32_t i = 0; i < cloud.clusters().size(); ++i) {
    const bool finest = cloud.tree().empty() || cloud.tree()[i].level == 0;
    if (finest && !cloud.clusters()[i].copies) wanted.push_back({0, i});
  }
  const std::size_t batch = std::max<std::size_t>(1, store.batch_clusters());
  const Vec3d shift = cloud.origin() - camera.eye;
  for (std::size_t from = 0; from < wanted.size(); from += std::min(batch, wanted.size() - from)) {
    const std::span<const VisibleCluster> some =
        std::span(wanted).subspan(from, std::min(batch, wanted.size() - from));
    store.fetch(some);
    for (const VisibleCluster& visible : some) {
      const Cluster& cluster = cloud.clusters()[visible.index];
      for (std::uint32_t i = cluster.begin; i < cluster.end; ++i) {
        const Vec3d p = camera.camera_from_world *
                        (Vec3d(static_cast<double>(cloud.x[i]), static_cast<double>(cloud.y[i]),
                               static_cast<double>(cloud.z[i])) +
                         shift);
        if (!(p.z() > camera.near)) continue;
        const double w = camera.orthographic ? 1 : p.z();
        const double x = std::floor(camera.focal_x * p.x() / w + camera.center_x);
        const double y = std::floor(camera.focal_y * p.y() / w + camera.center_y);
        if (!(x >= 0 && y >= 0 && x < camera.width && y < camera.height)) continue;
        count[static_cast<std::size_t>(y) * static_cast<std::size_t>(camera.width) +
              static_cast<std::size_t>(x)] += 1;
      }
    }
  }
  return count;
}

Image contact_sheet(const Image& picture, const std::vector<float>& density,
                    const Vec3f& background) {
  const std::array<SheetChannel, 3> color{{{picture, "R"}, {picture, "G"}, {picture, "B"}}};
  const std::array<SheetChannel, 3> normal{{{picture, "N.X"}, {picture, "N.Y"}, {picture, "N.Z"}}};
  const SheetChannel alpha(picture, "A");
  const SheetChannel depth(picture, "Z");
  const SheetChannel weight(picture, "weight");
  const std::size_t pixels =
      static_cast<std::size_t>(picture.width) * static_cast<std::size_t>(picture.height);

  std::vector<bool> open(pixels);
  std::vector<float> depths;
  std::vector<float> weights;
  std::vector<float> densities;
  for (std::size_t i = 0; i < pixels; ++i) {
    open[i] = !(alpha(i) >= 0.5F);
    if (open[i]) continue;
    if (std::isfinite(depth(i))) depths.push_back(depth(i));
    weights.push_back(weight(i));
    densities.push_back(density[i]);
  }
  const std::vector<bool> hole = enclosed(open, picture.width, picture.height);
  const auto holes = std::count(hole.begin(), hole.end(), true);
  const float nearest = share_below(depths, 0.01);
  const float farthest = share_below(depths, 0.99);
  const float most_weight = share_below(weights, 0.99);
  const float most_density = share_below(densities, 0.99);

  const ColorTable viridis(ColorMap::kViridis);
  const auto mapped = [&](float value, float low, float high) -> Vec3f {
    const float range = high - low;
    return viridis(range > 0 ? std::clamp((value - low) / range, 0.0F, 1.0F) : 0.0F);
  };
  const auto covered = [&](std::size_t i) { return open[i] ? 0.0F : 1.0F; };
  const auto where_covered = [&](std::size_t i, const Vec3f& c) {
    return open[i] ? Vec3f(0, 0, 0) : c;
  };
  Sheet sheet(picture, background);
  sheet.add(
      "color", [&](std::size_t i) { return Vec3f(color[0](i), color[1](i), color[2](i)); }, alpha);
  sheet.add(
      "normals",
      [&](std::size_t i) {
        const Vec3f n(normal[0](i), normal[1](i), normal[2](i));
        // A picture of normals is read by its codes, which go evenly from -1 to 1.
        Vec3f shown;
        for (int axis = 0; axis < 3; ++axis) shown[axis] = srgb_to_linear(0.5F + 0.5F * n[axis]);
        return where_covered(i, shown);
      },
      covered);
  sheet.add(
      fmt::format("depth {:.4g} to {:.4g}", nearest, farthest),
      [&](std::size_t i) {
        return where_covered(i, mapped(std::min(depth(i), farthest), nearest, farthest));
      },
      covered);
  sheet.add(
      fmt::format("surfels a pixel, 0 to {:.4g}", most_density),
      [&](std::size_t i) { return where_covered(i, mapped(density[i], 0, most_density)); },
      covered);
  sheet.add(
      fmt::format("holes: {} pixels", holes),
      [&](std::size_t i) {
        return hole[i] ? Vec3f(0.8F, 0, 0)
                       : where_covered(
                             i, Vec3f::Constant(0.2F + 0.4F * std::clamp(color[1](i), 0.0F, 1.0F)));
      },
      [&](std::size_t i) { return hole[i] ? 1.0F : covered(i); });
  sheet.add(
      fmt::format("weight 0 to {:.4g}", most_weight),
      [&](std::size_t i) { return where_covered(i, mapped(weight(i), 0, most_weight)); }, covered);
  return sheet.take();
}

}  // namespace surfel
