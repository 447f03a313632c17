// "OpenEXR File Layout", openexr.com.

#include <algorithm>
#include <array>
#include <bit>
#include <string_view>

#include <surfel/io/exr_header.h>
#include <surfel/io/image_plugin.h>
#include <surfel/io/record_table.h>

namespace surfel {
namespace {

/// Reads a header's attributes one after the other; past the end it reads nothing.
class ExrBytes {
 public:
  explicit ExrBytes(std::string_view bytes) : bytes_(bytes) {}

  /// Characters up to the zero that ends them.
  std::string_view name() {
    const std::size_t end = bytes_.find('\0');
    return end == std::string_view::npos ? take(bytes_.size()) : take(end + 1).substr(0, end);
  }
  std::size_t left() const { return bytes_.size(); }
  std::string_view take(std::size_t count) {
    const std::string_view taken = bytes_.substr(0, count);
    bytes_.remove_prefix(taken.size());
    return taken;
  }
  /// A number of 32 bits; 0 past the end.
  std::int32_t number() {
    const std::string_view taken = take(sizeof(std::int32_t));
    if (taken.size() < sizeof(std::int32_t)) return 0;
    constexpr bool kSwapped = std::endian::native == std::endian::big;
    return load_scalar<std::int32_t, kSwapped>(reinterpret_cast<const std::byte*>(taken.data()));
  }

 private:
  std::string_view bytes_;
};

/// Bytes that the channels of a pixel take, of which some channels may have fewer than the picture.
double pixel_bytes(ExrBytes list) {
  constexpr std::int32_t kHalf = 1;
  double bytes = 0;
  while (!list.name().empty()) {
    const double value = list.number() == kHalf ? 2 : 4;
    list.take(4);  // Linearity.
    const double columns = std::max(1, list.number());
    bytes += value / columns / std::max(1, list.number());
  }
  return bytes;
}

struct FixedSize {
  std::string_view type;
  std::size_t bytes;
};
/// Types of attributes whose values have one size.
constexpr std::array kFixedSizes{
    FixedSize{"box2f", 16},         FixedSize{"box2i", 16}, FixedSize{"chromaticities", 32},
    FixedSize{"compression", 1},    FixedSize{"double", 8}, FixedSize{"envmap", 1},
    FixedSize{"deepImageState", 1}, FixedSize{"float", 4},  FixedSize{"int", 4},
    FixedSize{"keycode", 28},       FixedSize{"m33d", 72},  FixedSize{"m33f", 36},
    FixedSize{"lineOrder", 1},      FixedSize{"m44d", 128}, FixedSize{"m44f", 64},
    FixedSize{"rational", 8},       FixedSize{"v2d", 16},   FixedSize{"v2f", 8},
    FixedSize{"tiledesc", 9},       FixedSize{"v2i", 8},    FixedSize{"v3d", 24},
    FixedSize{"timecode", 8},       FixedSize{"v3f", 12},   FixedSize{"v3i", 12}};

/// Does a value of that type end where its attribute ends?
bool fills_attribute(std::string_view type, ExrBytes value) {
  const std::size_t length = value.left();
  if (type == "chlist") {
    // A name of no characters ends the list; type, linearity and subsampling follow other names.
    while (value.left() > 0) {
      if (value.name().empty()) return value.left() == 0;
      if (value.take(16).size() < 16) return false;
    }
    return false;
  }
  if (type == "preview") {
    const auto width = static_cast<std::uint32_t>(value.number());
    const auto height = static_cast<std::uint32_t>(value.number());
    return length >= 8 && value.left() % 4 == 0 &&
           std::uint64_t{width} * height == value.left() / 4;
  }
  if (type == "stringvector") {
    while (value.left() > 0) {
      const auto text = static_cast<std::uint32_t>(value.number());
      if (text > value.left()) return false;
      value.take(text);
    }
    return true;
  }
  const auto fixed = std::find_if(kFixedSizes.begin(), kFixedSizes.end(),
                                  [&](const FixedSize& size) { return size.type == type; });
  return fixed == kFixedSizes.end() || fixed->bytes == length;
}

/// Bytes that a byte of the file can stand for, by compression: deflate's are 1032; DWA keeps of
/// empty blocks one value of 64.
constexpr std::array<double, 10> kBestRatios{1,    128,  1032, 1032,  1032,
                                             2064, 1032, 1032, 66048, 66048};

}  // namespace

std::optional<ExrSize> exr_size(const InputFile& file) {
  constexpr std::size_t kLongestHeader = std::size_t{1} << 20;
  const std::string_view head = as_text(file.head(kLongestHeader));
  const std::size_t unread = file.size() - head.size();
  ExrBytes in(head);
  if (!is_exr(file)) return std::nullopt;
  in.number();
  constexpr std::int32_t kMultipart = 0x1000;
  const bool multipart = (in.number() & kMultipart) != 0;
  ExrSize size;
  // Calls visit(name, value) for every attribute of a header; is there one?
  const auto attributes = [&](const auto& visit) {
    bool any = false;
    for (std::string_view name = in.name(); !name.empty(); name = in.name()) {
      any = true;
      const std::string_view type = in.name();
      const auto length = static_cast<std::uint32_t>(in.number());
      const ExrBytes value(in.take(length));
      // Of a header that is longer than what was read of it the rest is not known.
      const bool whole = value.left() == length;
      if (length > value.left() + unread || (whole && !fills_attribute(type, value))) {
        size.damaged = true;
      }
      visit(name, value);
    }
    return any;
  };
  attributes([&](std::string_view name, ExrBytes value) {
    if (name == "channels") {
      size.pixel_bytes = pixel_bytes(value);
    } else if (name == "compression") {
      const std::string_view kind = value.take(1);
      const std::size_t index = kind.empty() ? 0 : static_cast<unsigned char>(kind.front());
      if (index < kBestRatios.size()) size.best_ratio = kBestRatios[index];
    } else if (name == "dataWindow") {
      const std::array<std::int64_t, 4> box{value.number(), value.number(), value.number(),
                                            value.number()};
      size.pixels = {static_cast<std::size_t>(std::max<std::int64_t>(0, box[2] - box[0] + 1)),
                     static_cast<std::size_t>(std::max<std::int64_t>(0, box[3] - box[1] + 1))};
    }
  });
  // An empty header is the last.
  while (multipart && attributes([](std::string_view, const ExrBytes&) {})) continue;
  if (size.damaged) return size;
  const bool known = size.pixel_bytes > 0 && size.pixels.width > 0 && size.pixels.height > 0;
  if (!known) return std::nullopt;
  return size;
}

}  // namespace surfel
