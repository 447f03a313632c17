#include <algorithm>
#include <array>
#include <cstdint>
#include <cstring>
#include <memory>

#include <surfel/laz/color_coder.h>
#include <surfel/laz/gps_time_coder.h>
#include <surfel/laz/integer_coder.h>
#include <surfel/laz/layered_codec.h>
#include <surfel/laz/running_median.h>
#include <surfel/laz/wave_packet_coder.h>

namespace surfel::laz {
namespace {

/// One kind of values of a chunk.
template <class Coder>
struct Layer {
  Coder coder;
  bool coded = true;     ///< Else all points have the first one's values.
  bool changes = false;  ///< Some value that was coded differs from the one before.
};

/// The kinds of values that all points have, in the order of their layers.
enum PointLayer : std::size_t {
  kPlace,
  kHeight,
  kClassification,
  kFlags,
  kIntensity,
  kAngle,
  kUser,
  kSource,
  kTime,
  kPointLayers
};

/// The bytes that all points of formats 6 to 10 have.
struct LongPoint {
  static constexpr std::size_t kBytes = 30;
  static constexpr std::size_t kTimeAt = 22;

  std::uint32_t x = 0;
  std::uint32_t y = 0;
  std::uint32_t z = 0;
  std::uint16_t intensity = 0;
  std::uint8_t returns = 0;  ///< Number of the return, number of returns.
  std::uint8_t bits = 0;     ///< Four flags, the scanner channel, two flags.
  std::uint8_t classification = 0;
  std::uint8_t user = 0;
  std::uint16_t angle = 0;
  std::uint16_t source = 0;
  std::uint64_t time = 0;

  static LongPoint load(const std::byte* from) {
    LongPoint point;
    std::memcpy(&point.x, from, kTimeAt);
    std::memcpy(&point.time, from + kTimeAt, sizeof(time));
    return point;
  }
  void store(std::byte* to) const {
    std::memcpy(to, &x, kTimeAt);
    std::memcpy(to + kTimeAt, &time, sizeof(time));
  }
  unsigned return_number() const { return returns & 15U; }
  unsigned number_of_returns() const { return returns >> 4; }
  void set_returns(unsigned r, unsigned n) { returns = static_cast<std::uint8_t>(n << 4 | r); }
  unsigned channel() const { return bits >> 4 & 3U; }
  void set_channel(unsigned channel) {
    bits = static_cast<std::uint8_t>((bits & ~0x30U) | channel << 4);
  }
  /// The six flags side by side.
  unsigned flags() const { return (bits & 15U) | (bits >> 2 & 0x30U); }
  void set_flags(unsigned flags) {
    bits = static_cast<std::uint8_t>((bits & 0x30U) | (flags & 15U) | (flags & 0x30U) << 2);
  }
};
static_assert(offsetof(LongPoint, source) + 2 == LongPoint::kTimeAt);

/// Points that are about as far from the points before them, by the number of returns (row) and
/// of the return. Writers that swap the two, or count from zero, get places, too.
constexpr std::uint8_t kLongReturnPlaces[16][16] = {
    {0, 1, 2, 3, 4, 5, 3, 4, 4, 5, 5, 5, 5, 5, 5, 5},
    {1, 0, 1, 3, 3, 3, 3, 3, 3, 3, 3, 3, 3, 3, 3, 3},
    {2, 1, 2, 4, 4, 4, 4, 4, 4, 4, 4, 3, 3, 3, 3, 3},
    {3, 3, 4, 5, 4, 4, 4, 4, 4, 4, 4, 4, 4, 4, 4, 4},
    {4, 3, 4, 4, 5, 4, 4, 4, 4, 4, 4, 4, 4, 4, 4, 4},
    {5, 3, 4, 4, 4, 5, 4, 4, 4, 4, 4, 4, 4, 4, 4, 4},
    {3, 3, 4, 4, 4, 4, 5, 4, 4, 4, 4, 4, 4, 4, 4, 4},
    {4, 3, 4, 4, 4, 4, 4, 5, 4, 4, 4, 4, 4, 4, 4, 4},
    {4, 3, 4, 4, 4, 4, 4, 4, 5, 4, 4, 4, 4, 4, 4, 4},
    {5, 3, 4, 4, 4, 4, 4, 4, 4, 5, 4, 4, 4, 4, 4, 4},
    {5, 3, 4, 4, 4, 4, 4, 4, 4, 4, 5, 4, 4, 4, 4, 4},
    {5, 3, 3, 4, 4, 4, 4, 4, 4, 4, 4, 5, 5, 4, 4, 4},
    {5, 3, 3, 4, 4, 4, 4, 4, 4, 4, 4, 5, 5, 5, 4, 4},
    {5, 3, 3, 4, 4, 4, 4, 4, 4, 4, 4, 4, 5, 5, 5, 4},
    {5, 3, 3, 4, 4, 4, 4, 4, 4, 4, 4, 4, 4, 5, 5, 5},
    {5, 3, 3, 4, 4, 4, 4, 4, 4, 4, 4, 4, 4, 4, 5, 5}};

/// 1 for the first return of a pulse, 2 for the last, 3 for a single one, 0 for returns between.
unsigned kind_of_return(const LongPoint& point) {
  const unsigned r = point.return_number();
  return (r == 1 ? 1U : 0U) + (r >= point.number_of_returns() ? 2U : 0U);
}

/// What is known of the points of one scanner channel.
struct ChannelModels {
  explicit ChannelModels(const LongPoint& first) : last(first), time(first.time) {
    heights.fill(first.z);
    intensities.fill(first.intensity);
    for (SymbolModel& model : changed) model.reset(128);
  }

  LongPoint last;
  bool time_changed = false;  ///< The time of the last point differs from the one before.
  std::array<std::uint16_t, 8> intensities{};
  std::array<RunningMedian, 12> x_steps;
  std::array<RunningMedian, 12> y_steps;
  std::array<std::uint32_t, 8> heights{};
  std::array<SymbolModel, 8> changed;
  SymbolModel channel{3};
  std::array<SymbolModel, 16> number_of_returns;
  std::array<SymbolModel, 16> return_number;
  SymbolModel return_step{13};
  std::array<SymbolModel, 64> classification;
  std::array<SymbolModel, 64> flags;
  std::array<SymbolModel, 64> user;
  IntegerCoder x{32, 2};
  IntegerCoder y{32, 22};
  IntegerCoder z{32, 20};
  IntegerCoder intensity{16, 4};
  IntegerCoder angle{16, 2};
  IntegerCoder source{16};
  GpsTimeCoder<false> time;
};

template <class Coder>
class LongPointCoder {
 public:
  /// \param version  PointLayout::layered_version
  LongPointCoder(std::span<Layer<Coder>> layers, const std::byte* first, int version)
      : layers_(layers), version_(version) {
    const LongPoint point = LongPoint::load(first);
    channel_ = point.channel();
    models_[channel_] = std::make_unique<ChannelModels>(point);
  }

  /// Codes a point; returns the scanner channel whose models its other items have.
  unsigned code(std::byte* bytes) {
    LongPoint now;
    if constexpr (!Coder::kDecodes) now = LongPoint::load(bytes);
    const unsigned changed = code_changes(now);
    ChannelModels& m = *models_[channel_];
    const bool time_changed = (changed & 16) != 0;
    LongPoint point = m.last;
    code_returns(m, changed, now, point);
    code_place(m, time_changed, now, point);
    code_values(m, changed, now, point);
    if (time_changed) {
      code_if(kTime, point.time, now.time,
              [&](Coder& coder) { return m.time.code(coder, [&] { return now.time; }); });
    }
    m.last = point;
    m.time_changed = time_changed;
    if constexpr (Coder::kDecodes) point.store(bytes);
    // LASzip's items of version 3 pass the channel on only where it changes, and 0 elsewhere.
    return version_ >= 4 || (changed & 64) != 0 ? channel_ : 0;
  }

 private:
  /// Codes a value by code(coder) if its layer is coded.
  template <class T, class Code>
  void code_if(std::size_t index, T& value, T now, const Code& code) {
    Layer<Coder>& layer = layers_[index];
    if (!layer.coded) return;
    if constexpr (!Coder::kDecodes) layer.changes |= value != now;
    value = static_cast<T>(code(layer.coder));
  }

  unsigned changes(const LongPoint& now) const {
    const unsigned channel = now.channel();
    const LongPoint& last = (models_[channel] ? models_[channel] : models_[channel_])->last;
    const unsigned step = (now.return_number() - last.return_number()) & 15;
    return (channel != channel_ ? 64U : 0U) | (now.source != last.source ? 32U : 0U) |
           (now.time != last.time ? 16U : 0U) | (now.angle != last.angle ? 8U : 0U) |
           (now.number_of_returns() != last.number_of_returns() ? 4U : 0U) |
           (step == 15 ? 2U : std::min(step, 3U) + (step == 2 ? 1U : 0U));
  }

  /// Codes which values differ from the last point's of the channel, and the channel.
  unsigned code_changes(const LongPoint& now) {
    ChannelModels& m = *models_[channel_];
    Coder& coder = layers_[kPlace].coder;
    const unsigned context = kind_of_return(m.last) + (m.time_changed ? 4 : 0);
    const unsigned changed = coder.symbol(m.changed[context], [&] { return changes(now); });
    if ((changed & 64) == 0) return changed;
    const unsigned step =
        coder.symbol(m.channel, [&] { return (now.channel() - channel_ - 1) & 3; });
    channel_ = (channel_ + step + 1) & 3;
    std::unique_ptr<ChannelModels>& next = models_[channel_];
    if (!next) next = std::make_unique<ChannelModels>(m.last);
    next->last.set_channel(channel_);
    return changed;
  }

  void code_returns(ChannelModels& m, unsigned changed, const LongPoint& now, LongPoint& point) {
    Coder& coder = layers_[kPlace].coder;
    const unsigned last_n = point.number_of_returns();
    const unsigned last_r = point.return_number();
    unsigned n = last_n;
    if (changed & 4) {
      n = coder.symbol(made(m.number_of_returns[last_n], 16),
                       [&] { return now.number_of_returns(); });
    }
    unsigned r = last_r;
    switch (changed & 3) {
      case 0:
        break;
      case 1:
        r = (last_r + 1) & 15;
        break;
      case 2:
        r = (last_r + 15) & 15;
        break;
      default:
        if (changed & 16) {
          r = coder.symbol(made(m.return_number[last_r], 16), [&] { return now.return_number(); });
        } else {
          const unsigned step =
              coder.symbol(m.return_step, [&] { return (now.return_number() - last_r - 2) & 15; });
          r = (last_r + step + 2) & 15;
        }
    }
    point.set_returns(r, n);
  }

  void code_place(ChannelModels& m, bool time_changed, const LongPoint& now, LongPoint& point) {
    Coder& coder = layers_[kPlace].coder;
    const unsigned r = point.return_number();
    const unsigned n = point.number_of_returns();
    const unsigned single = n == 1 ? 1 : 0;
    const std::size_t place = 2U * kLongReturnPlaces[n][r] + (time_changed ? 1 : 0);
    const std::uint32_t dx =
        m.x.code(coder, single, m.x_steps[place].median(), [&] { return now.x - point.x; });
    point.x += dx;
    m.x_steps[place].add(dx);
    const unsigned x_length = m.x.length();
    const std::uint32_t dy = m.y.code(coder, single + (x_length < 20 ? x_length & ~1U : 20),
                                      m.y_steps[place].median(), [&] { return now.y - point.y; });
    point.y += dy;
    m.y_steps[place].add(dy);
    const unsigned length = (x_length + m.y.length()) / 2;
    std::uint32_t& height = m.heights[std::min(n > r ? n - r : r - n, 7U)];
    code_if(kHeight, point.z, now.z, [&](Coder& heights) {
      height = m.z.code(heights, single + (length < 18 ? length & ~1U : 18), height,
                        [&] { return now.z; });
      return height;
    });
  }

  void code_values(ChannelModels& m, unsigned changed, const LongPoint& now, LongPoint& point) {
    const unsigned kind = kind_of_return(point);
    const unsigned time_changed = (changed & 16) != 0 ? 1 : 0;
    code_if(kClassification, point.classification, now.classification, [&](Coder& coder) {
      const unsigned context = (point.classification & 31U) * 2 + (kind == 3 ? 1 : 0);
      return coder.symbol(made(m.classification[context], 256), [&] { return now.classification; });
    });
    unsigned flags = point.flags();
    code_if(kFlags, flags, now.flags(), [&](Coder& coder) {
      return coder.symbol(made(m.flags[point.flags()], 64), [&] { return now.flags(); });
    });
    point.set_flags(flags);
    code_if(kIntensity, point.intensity, now.intensity, [&](Coder& coder) {
      std::uint16_t& last = m.intensities[kind * 2 + time_changed];
      last = static_cast<std::uint16_t>(
          m.intensity.code(coder, kind, last, [&] { return std::uint32_t{now.intensity}; }));
      return last;
    });
    if (changed & 8) {
      code_if(kAngle, point.angle, now.angle, [&](Coder& coder) {
        return m.angle.code(coder, time_changed, point.angle,
                            [&] { return std::uint32_t{now.angle}; });
      });
    }
    code_if(kUser, point.user, now.user, [&](Coder& coder) {
      return coder.symbol(made(m.user[point.user / 4], 256), [&] { return now.user; });
    });
    if (changed & 32) {
      code_if(kSource, point.source, now.source, [&](Coder& coder) {
        return m.source.code(coder, 0, point.source, [&] { return std::uint32_t{now.source}; });
      });
    }
  }

  std::span<Layer<Coder>> layers_;
  int version_;
  unsigned channel_;
  std::array<std::unique_ptr<ChannelModels>, 4> models_;
};

/// Models of one more item of a point for each scanner channel, and the item's last value there.
template <class Models, class Value>
class Channels {
 public:
  Channels(unsigned channel, const Value& first, const Models& fresh, bool own_last)
      : channel_(channel), fresh_(fresh), own_last_(own_last) {
    used_[channel] = std::make_unique<Used>(Used{fresh_, first});
  }

  /// Calls code(models, last) for a point of the channel, with the value to predict it from.
  template <class Code>
  auto with(unsigned channel, const Code& code) {
    Value* last = &used_[channel_]->last;
    if (channel != channel_) {
      channel_ = channel;
      const bool fresh = !used_[channel];
      if (fresh) used_[channel] = std::make_unique<Used>(Used{fresh_, *last});
      if (fresh || own_last_) last = &used_[channel]->last;
    }
    return code(used_[channel]->models, *last);
  }

 private:
  struct Used {
    Models models;
    Value last;
  };
  unsigned channel_;
  Models fresh_;
  bool own_last_;
  std::array<std::unique_ptr<Used>, 4> used_;
};

template <class Coder>
class LayeredCodec {
 public:
  /// \param layers  as many as layer_count() says; kept as a reference
  LayeredCodec(const PointLayout& layout, const std::byte* first, std::span<Layer<Coder>> layers)
      : layers_(layers), base_(layers, first, layout.layered_version) {
    const bool own_last = layout.layered_version >= 4;
    const unsigned channel = LongPoint::load(first).channel();
    std::size_t at = LongPoint::kBytes;
    if (layout.colored()) {
      Color color;
      std::memcpy(color.data(), first + at, sizeof(color));
      color_ =
          std::make_unique<Channels<ColorCoder, Color>>(channel, color, ColorCoder(), own_last);
      at += sizeof(color);
    }
    if (layout.infrared()) {
      std::uint16_t value;
      std::memcpy(&value, first + at, sizeof(value));
      infrared_ = std::make_unique<Channels<InfraredCoder, std::uint16_t>>(
          channel, value, InfraredCoder(), own_last);
      at += sizeof(value);
    }
    if (layout.waves()) {
      wave_ = std::make_unique<Channels<WavePacketCoder, WavePacket>>(
          channel, WavePacket::load(first + at), WavePacketCoder(), own_last);
      at += WavePacket::kBytes;
    }
    extra_ = std::make_unique<Channels<std::vector<SymbolModel>, std::vector<std::byte>>>(
        channel, std::vector<std::byte>(first + at, first + layout.bytes),
        std::vector<SymbolModel>(layout.extra(), SymbolModel(256)), own_last);
  }

  static std::size_t layer_count(const PointLayout& layout) {
    return kPointLayers + (layout.colored() ? 1 : 0) + (layout.infrared() ? 1 : 0) +
           (layout.waves() ? 1 : 0) + layout.extra();
  }

  void code(std::byte* point) {
    const unsigned channel = base_.code(point);
    point += LongPoint::kBytes;
    std::size_t layer = kPointLayers;
    if (color_) {
      Color color;
      std::memcpy(color.data(), point, sizeof(color));
      color = code_item(*color_, channel, layers_[layer++], color);
      std::memcpy(point, color.data(), sizeof(color));
      point += sizeof(color);
    }
    if (infrared_) {
      std::uint16_t value;
      std::memcpy(&value, point, sizeof(value));
      value = code_item(*infrared_, channel, layers_[layer++], value);
      std::memcpy(point, &value, sizeof(value));
      point += sizeof(value);
    }
    if (wave_) {
      code_item(*wave_, channel, layers_[layer++], WavePacket::load(point)).store(point);
      point += WavePacket::kBytes;
    }
    extra_->with(channel, [&](std::vector<SymbolModel>& models, std::vector<std::byte>& last) {
      for (std::size_t i = 0; i < last.size(); ++i) {
        Layer<Coder>& own = layers_[layer + i];
        if constexpr (!Coder::kDecodes) own.changes |= point[i] != last[i];
        if (own.coded) {
          last[i] = static_cast<std::byte>(code_byte(own.coder, models[i],
                                                     std::to_integer<unsigned>(last[i]),
                                                     std::to_integer<unsigned>(point[i])));
        }
        point[i] = last[i];
      }
    });
  }

 private:
  template <class Models, class Value>
  static Value code_item(Channels<Models, Value>& channels, unsigned channel, Layer<Coder>& layer,
                         const Value& now) {
    return channels.with(channel, [&](Models& models, Value& last) {
      if constexpr (!Coder::kDecodes) layer.changes |= !(last == now);
      return layer.coded ? models.code(layer.coder, last, now) : last;
    });
  }

  std::span<Layer<Coder>> layers_;
  LongPointCoder<Coder> base_;
  std::unique_ptr<Channels<ColorCoder, Color>> color_;
  std::unique_ptr<Channels<InfraredCoder, std::uint16_t>> infrared_;
  std::unique_ptr<Channels<WavePacketCoder, WavePacket>> wave_;
  std::unique_ptr<Channels<std::vector<SymbolModel>, std::vector<std::byte>>> extra_;
};

void append(std::vector<std::uint8_t>& chunk, std::uint32_t value) {
  for (int shift = 0; shift < 32; shift += 8) {
    chunk.push_back(static_cast<std::uint8_t>(value >> shift));
  }
}

std::uint32_t take_number(std::span<const std::byte>& bytes) {
  std::uint32_t value = 0;
  if (bytes.size() < sizeof(value)) throw Damage();
  std::memcpy(&value, bytes.data(), sizeof(value));
  bytes = bytes.subspan(sizeof(value));
  return value;
}

}  // namespace

void encode_layered(const PointLayout& layout, const std::byte* points, std::size_t count,
                    std::vector<std::uint8_t>& chunk) {
  const auto* bytes = reinterpret_cast<const std::uint8_t*>(points);
  chunk.insert(chunk.end(), bytes, bytes + layout.bytes);
  append(chunk, static_cast<std::uint32_t>(count));
  std::vector<Layer<RangeEncoder>> layers(LayeredCodec<RangeEncoder>::layer_count(layout));
  LayeredCodec<RangeEncoder> codec(layout, points, layers);
  std::vector<std::byte> point(layout.bytes);
  for (std::size_t i = 1; i < count; ++i) {
    std::memcpy(point.data(), points + i * layout.bytes, layout.bytes);
    codec.code(point.data());
  }
  layers[kPlace].changes = true;
  for (Layer<RangeEncoder>& layer : layers) {
    if (layer.changes) layer.coder.finish();
    append(chunk, layer.changes ? static_cast<std::uint32_t>(layer.coder.bytes().size()) : 0);
  }
  for (const Layer<RangeEncoder>& layer : layers) {
    if (!layer.changes) continue;
    chunk.insert(chunk.end(), layer.coder.bytes().begin(), layer.coder.bytes().end());
  }
}

void decode_layered(const PointLayout& layout, std::span<const std::byte> chunk, std::size_t count,
                    std::byte* points) {
  if (chunk.size() < layout.bytes) throw Damage();
  std::memcpy(points, chunk.data(), layout.bytes);
  chunk = chunk.subspan(layout.bytes);
  if (take_number(chunk) != count) throw Damage();
  std::vector<Layer<RangeDecoder>> layers(LayeredCodec<RangeDecoder>::layer_count(layout));
  std::vector<std::size_t> sizes;
  for (std::size_t i = 0; i < layers.size(); ++i) sizes.push_back(take_number(chunk));
  for (std::size_t i = 0; i < layers.size(); ++i) {
    if (sizes[i] > chunk.size()) throw Damage();
    layers[i].coded = sizes[i] > 0;
    if (layers[i].coded) layers[i].coder = RangeDecoder(chunk.first(sizes[i]));
    chunk = chunk.subspan(sizes[i]);
  }
  if (count == 1) return;
  if (!layers[kPlace].coded) throw Damage();
  LayeredCodec<RangeDecoder> codec(layout, points, layers);
  for (std::size_t i = 1; i < count; ++i) {
    points += layout.bytes;
    // What is decoded is written over; the codec may read it before.
    std::memcpy(points, points - layout.bytes, layout.bytes);
    codec.code(points);
  }
}

}  // namespace surfel::laz
