#include <algorithm>
#include <array>
#include <cstdint>
#include <cstring>
#include <memory>
#include <optional>

#include <surfel/laz/color_coder.h>
#include <surfel/laz/gps_time_coder.h>
#include <surfel/laz/integer_coder.h>
#include <surfel/laz/pointwise_codec.h>
#include <surfel/laz/running_median.h>
#include <surfel/laz/wave_packet_coder.h>

namespace surfel::laz {
namespace {

/// The bytes that all points of formats 0 to 5 have.
struct ShortPoint {
  static constexpr std::size_t kBytes = 20;

  std::uint32_t x;
  std::uint32_t y;
  std::uint32_t z;
  std::uint16_t intensity;
  std::uint8_t returns;  ///< Number of the return, of returns, and two flags.
  std::uint8_t classification;
  std::uint8_t angle;
  std::uint8_t user;
  std::uint16_t source;

  unsigned return_number() const { return returns & 7U; }
  unsigned number_of_returns() const { return returns >> 3 & 7U; }
  unsigned direction() const { return returns >> 6 & 1U; }
};
static_assert(sizeof(ShortPoint) == ShortPoint::kBytes);

/// Points that are about as far from the points before them, by the number of returns (row) and
/// of the return. The upper right half has the pairs that make sense; writers that swap the two, or
/// count from zero, get places, too.
constexpr std::uint8_t kShortReturnPlaces[8][8] = {
    {15, 14, 13, 12, 11, 10, 9, 8},  {14, 0, 1, 3, 6, 10, 10, 9},
    {13, 1, 2, 4, 7, 11, 11, 10},    {12, 3, 4, 5, 8, 12, 12, 11},
    {11, 6, 7, 8, 9, 13, 13, 12},    {10, 10, 11, 12, 13, 14, 14, 13},
    {9, 10, 11, 12, 13, 14, 15, 14}, {8, 9, 10, 11, 12, 13, 14, 15}};

class ShortPointCoder {
 public:
  explicit ShortPointCoder(const std::byte* first) {
    std::memcpy(&last_, first, ShortPoint::kBytes);
    last_.intensity = 0;
  }

  template <class Coder>
  void code(Coder& coder, std::byte* point) {
    ShortPoint now = last_;
    if constexpr (!Coder::kDecodes) std::memcpy(&now, point, ShortPoint::kBytes);
    const unsigned changed = coder.symbol(changed_, [&] { return changes(now); });
    now.returns = code_if(coder, changed & 32, returns_, last_.returns, now.returns);
    const unsigned r = now.return_number();
    const unsigned n = now.number_of_returns();
    const std::size_t place = kShortReturnPlaces[n][r];
    if (changed & 16) {
      intensities_[place] = static_cast<std::uint16_t>(
          intensity_.code(coder, static_cast<unsigned>(std::min<std::size_t>(place, 3)),
                          intensities_[place], [&] { return std::uint32_t{now.intensity}; }));
    }
    now.intensity = intensities_[place];
    now.classification =
        code_if(coder, changed & 8, classification_, last_.classification, now.classification);
    const std::uint8_t angle = now.angle;
    now.angle = last_.angle;
    if (changed & 4) {
      now.angle =
          static_cast<std::uint8_t>(code_byte(coder, angle_[now.direction()], last_.angle, angle));
    }
    now.user = code_if(coder, changed & 2, user_, last_.user, now.user);
    const std::uint16_t source = now.source;
    now.source = last_.source;
    if (changed & 1) {
      now.source = static_cast<std::uint16_t>(
          source_.code(coder, 0, last_.source, [&] { return std::uint32_t{source}; }));
    }
    code_place(coder, now, n == 1 ? 1 : 0, place, n > r ? n - r : r - n);
    last_ = now;
    if constexpr (Coder::kDecodes) std::memcpy(point, &now, ShortPoint::kBytes);
  }

 private:
  /// A model for each value that a byte had before.
  using ByteModels = std::unique_ptr<std::array<SymbolModel, 256>>;
  static ByteModels make_models() { return std::make_unique<std::array<SymbolModel, 256>>(); }

  unsigned changes(const ShortPoint& now) const {
    const std::size_t place = kShortReturnPlaces[now.number_of_returns()][now.return_number()];
    return (now.returns != last_.returns ? 32U : 0U) |
           (now.intensity != intensities_[place] ? 16U : 0U) |
           (now.classification != last_.classification ? 8U : 0U) |
           (now.angle != last_.angle ? 4U : 0U) | (now.user != last_.user ? 2U : 0U) |
           (now.source != last_.source ? 1U : 0U);
  }

  template <class Coder>
  static std::uint8_t code_if(Coder& coder, unsigned changed, const ByteModels& models,
                              std::uint8_t last, std::uint8_t now) {
    if (changed == 0) return last;
    return static_cast<std::uint8_t>(
        coder.symbol(made((*models)[last], 256), [&] { return unsigned{now}; }));
  }

  /// \param single  1 if the pulse has one return, else 0
  template <class Coder>
  void code_place(Coder& coder, ShortPoint& now, unsigned single, std::size_t place,
                  std::size_t depth) {
    const std::uint32_t dx =
        x_.code(coder, single, x_steps_[place].median(), [&] { return now.x - last_.x; });
    now.x = last_.x + dx;
    x_steps_[place].add(dx);
    unsigned length = x_.length();
    const std::uint32_t dy = y_.code(coder, single + (length < 20 ? length & ~1U : 20),
                                     y_steps_[place].median(), [&] { return now.y - last_.y; });
    now.y = last_.y + dy;
    y_steps_[place].add(dy);
    length = (x_.length() + y_.length()) / 2;
    now.z = z_.code(coder, single + (length < 18 ? length & ~1U : 18), heights_[depth],
                    [&] { return now.z; });
    heights_[depth] = now.z;
  }

  ShortPoint last_;
  std::array<std::uint16_t, 16> intensities_{};
  std::array<RunningMedian, 16> x_steps_;
  std::array<RunningMedian, 16> y_steps_;
  std::array<std::uint32_t, 8> heights_{};
  SymbolModel changed_{64};
  ByteModels returns_ = make_models();
  ByteModels classification_ = make_models();
  ByteModels user_ = make_models();
  std::array<SymbolModel, 2> angle_{SymbolModel(256), SymbolModel(256)};
  IntegerCoder intensity_{16, 4};
  IntegerCoder source_{16};
  IntegerCoder x_{32, 2};
  IntegerCoder y_{32, 22};
  IntegerCoder z_{32, 20};
};

/// Codes the points after the first one.
class PointwiseCodec {
 public:
  PointwiseCodec(const PointLayout& layout, const std::byte* first)
      : base_(first), extra_(layout.extra(), SymbolModel(256)) {
    std::size_t at = ShortPoint::kBytes;
    if (layout.timed()) {
      std::uint64_t time = 0;
      std::memcpy(&time, first + at, sizeof(time));
      time_.emplace(time);
      at += sizeof(time);
    }
    if (layout.colored()) {
      color_.emplace();
      std::memcpy(last_color_.data(), first + at, sizeof(last_color_));
      at += sizeof(last_color_);
    }
    if (layout.waves()) {
      wave_.emplace();
      last_wave_ = WavePacket::load(first + at);
      at += WavePacket::kBytes;
    }
    last_extra_.assign(first + at, first + layout.bytes);
  }

  template <class Coder>
  void code(Coder& coder, std::byte* point) {
    base_.code(coder, point);
    point += ShortPoint::kBytes;
    if (time_) {
      const std::uint64_t time = time_->code(coder, [&] {
        std::uint64_t value = 0;
        std::memcpy(&value, point, sizeof(value));
        return value;
      });
      std::memcpy(point, &time, sizeof(time));
      point += sizeof(time);
    }
    if (color_) {
      Color now;
      std::memcpy(now.data(), point, sizeof(now));
      now = color_->code(coder, last_color_, now);
      std::memcpy(point, now.data(), sizeof(now));
      point += sizeof(now);
    }
    if (wave_) {
      wave_->code(coder, last_wave_, WavePacket::load(point)).store(point);
      point += WavePacket::kBytes;
    }
    for (std::size_t i = 0; i < last_extra_.size(); ++i) {
      last_extra_[i] = static_cast<std::byte>(code_byte(coder, extra_[i],
                                                        std::to_integer<unsigned>(last_extra_[i]),
                                                        std::to_integer<unsigned>(point[i])));
      point[i] = last_extra_[i];
    }
  }

 private:
  ShortPointCoder base_;
  std::optional<GpsTimeCoder<true>> time_;
  std::optional<ColorCoder> color_;
  Color last_color_{};
  std::optional<WavePacketCoder> wave_;
  WavePacket last_wave_;
  std::vector<SymbolModel> extra_;
  std::vector<std::byte> last_extra_;
};

}  // namespace

void encode_pointwise(const PointLayout& layout, const std::byte* points, std::size_t count,
                      std::vector<std::uint8_t>& chunk) {
  const auto* bytes = reinterpret_cast<const std::uint8_t*>(points);
  chunk.insert(chunk.end(), bytes, bytes + layout.bytes);
  const auto codec = std::make_unique<PointwiseCodec>(layout, points);
  RangeEncoder coder;
  std::vector<std::byte> point(layout.bytes);
  for (std::size_t i = 1; i < count; ++i) {
    std::memcpy(point.data(), points + i * layout.bytes, layout.bytes);
    codec->code(coder, point.data());
  }
  coder.finish();
  chunk.insert(chunk.end(), coder.bytes().begin(), coder.bytes().end());
}

void decode_pointwise(const PointLayout& layout, std::span<const std::byte> chunk,
                      std::size_t count, std::byte* points) {
  if (chunk.size() < layout.bytes) throw Damage();
  std::memcpy(points, chunk.data(), layout.bytes);
  if (count == 1) return;
  const auto codec = std::make_unique<PointwiseCodec>(layout, points);
  RangeDecoder coder(chunk.subspan(layout.bytes));
  for (std::size_t i = 1; i < count; ++i) {
    points += layout.bytes;
    // What is decoded is written over; the codec may read it before.
    std::memcpy(points, points - layout.bytes, layout.bytes);
    codec->code(coder, points);
  }
}

}  // namespace surfel::laz
