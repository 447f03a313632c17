#pragma once

#include <Eigen/Core>
#include <algorithm>
#include <array>
#include <atomic>
#include <cstddef>
#include <cstdint>
#include <cstring>
#include <memory>
#include <utility>
#include <vector>

#include <surfel/base/color.h>

namespace surfel {

/// Decodes texels in straight R G B A of 8 bits, R G B encoded as sRGB: linear and premultiplied.
class TexelDecoder {
 public:
  TexelDecoder() {
    for (std::size_t i = 0; i < linear_.size(); ++i) {
      linear_[i] = srgb8_to_linear(static_cast<std::uint8_t>(i));
    }
  }
  Eigen::Array4f operator()(const std::uint8_t* rgba) const {
    const float alpha = static_cast<float>(rgba[3]) / 255.0F;
    return {linear_[rgba[0]] * alpha, linear_[rgba[1]] * alpha, linear_[rgba[2]] * alpha, alpha};
  }

 private:
  std::array<float, 256> linear_;  ///< Linear light of every byte.
};

/// The texels of an image that are wanted, by square tiles: premultiplied floats, or as their file
/// codes them in 8 bits, which are decoded at each use.
class TexelTiles {
 public:
  static constexpr int kSize = 64;  ///< Texels a side: a tile of floats takes 64 KB.

  TexelTiles(int width, int height, bool coded)
      : coded_(coded),
        columns_((width + kSize - 1) / kSize),
        rows_((height + kSize - 1) / kSize),
        wanted_(static_cast<std::size_t>(columns_) * rows_, std::uint8_t{0}),
        tile_(wanted_.size()) {}

  /// Tiles along each axis.
  int columns() const { return columns_; }
  int rows() const { return rows_; }

  /// May be called from several threads.
  void want(int column, int row) {
    std::atomic_ref(wanted_[index(column, row)]).store(1, std::memory_order_relaxed);
  }
  bool is_wanted(int column, int row) const { return wanted_[index(column, row)] != 0; }
  bool is_stored(int column, int row) const { return tile_[index(column, row)] != nullptr; }
  std::size_t wanted_bytes() const {
    const auto count = std::count(wanted_.begin(), wanted_.end(), std::uint8_t{1});
    return static_cast<std::size_t>(count) * tile_bytes();
  }

  /// Keeps the texels x_begin ... x_end - 1 of row y that lie in wanted tiles.
  void store(int y, int x_begin, int x_end, const std::byte* texels) {
    for (int x = x_begin; x < x_end;) {
      const int next = std::min(x_end, (x / kSize + 1) * kSize);
      if (is_wanted(x / kSize, y / kSize)) {
        std::unique_ptr<std::byte[]>& tile = tile_[index(x / kSize, y / kSize)];
        if (!tile) tile.reset(new std::byte[tile_bytes()]);
        std::memcpy(tile.get() + place(x, y), texels + (x - x_begin) * texel_bytes(),
                    (next - x) * texel_bytes());
      }
      x = next;
    }
  }
  std::size_t texel_bytes() const { return coded_ ? 4 : 4 * sizeof(float); }

  /// Premultiplied colour of a texel, whose tile must have been stored.
  Eigen::Array4f texel(int x, int y) const {
    const std::byte* texel = tile_[index(x / kSize, y / kSize)].get() + place(x, y);
    if (coded_) return decode_(reinterpret_cast<const std::uint8_t*>(texel));
    return Eigen::Map<const Eigen::Array4f>(reinterpret_cast<const float*>(texel));
  }
  /// Texels x_begin ... x_end - 1 of row y, four floats each.
  void row(int y, int x_begin, int x_end, float* out) const {
    for (int x = x_begin; x < x_end;) {
      const int next = std::min(x_end, (x / kSize + 1) * kSize);
      const std::byte* texel = tile_[index(x / kSize, y / kSize)].get() + place(x, y);
      if (coded_) {
        for (; x < next; ++x, texel += 4, out += 4) {
          Eigen::Map<Eigen::Array4f> to(out);
          to = decode_(reinterpret_cast<const std::uint8_t*>(texel));
        }
      } else {
        std::memcpy(out, texel, static_cast<std::size_t>(next - x) * texel_bytes());
        out += static_cast<std::ptrdiff_t>(next - x) * 4;
        x = next;
      }
    }
  }

 private:
  std::size_t index(int column, int row) const {
    return static_cast<std::size_t>(row) * columns_ + column;
  }
  std::size_t tile_bytes() const { return kSize * kSize * texel_bytes(); }
  std::size_t place(int x, int y) const {
    return static_cast<std::size_t>(y % kSize * kSize + x % kSize) * texel_bytes();
  }

  TexelDecoder decode_;
  bool coded_;
  int columns_;
  int rows_;
  std::vector<std::uint8_t> wanted_;
  std::vector<std::unique_ptr<std::byte[]>> tile_;
};

}  // namespace surfel
