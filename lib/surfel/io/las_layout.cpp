#include <algorithm>
#include <cstring>

#include <fmt/format.h>
#include <surfel/base/error.h>
#include <surfel/io/las_layout.h>
#include <surfel/io/promises.h>

namespace surfel {
namespace {

using enum ScalarType;

constexpr std::size_t kDescription = 192;  ///< Bytes of the description of some extra bytes.

/// The types of extra bytes by their numbers 1 to 10; 7 and 8 are 64-bit integers.
constexpr ScalarType kExtraTypes[] = {kUint8, kInt8,  kUint16, kInt16,   kUint32,
                                      kInt32, kUint8, kInt8,   kFloat32, kFloat64};

/// A name that PLY and PCD headers can hold.
std::string column_name(std::string_view text) {
  std::string name(text.substr(0, text.find('\0')));
  std::replace_if(
      name.begin(), name.end(), [](unsigned char c) { return c <= ' ' || c >= 0x7f; }, '_');
  return name;
}

}  // namespace

std::size_t las_color_offset(int point_format) {
  const laz::PointLayout layout{.format = point_format};
  return layout.colored() ? layout.base() : 0;
}

std::vector<LasField> las_fields(int point_format) {
  const laz::PointLayout layout{.format = point_format};
  std::vector<LasField> fields{{"intensity", kUint16, 12}};
  const auto add = [&](std::initializer_list<LasField> more) { fields.insert(fields.end(), more); };
  if (layout.layered()) {
    add({{"return_number", kUint8, 14, 0, 4},
         {"number_of_returns", kUint8, 14, 4, 4},
         {"synthetic", kUint8, 15, 0, 1},
         {"key_point", kUint8, 15, 1, 1},
         {"withheld", kUint8, 15, 2, 1},
         {"overlap", kUint8, 15, 3, 1},
         {"scanner_channel", kUint8, 15, 4, 2},
         {"scan_direction_flag", kUint8, 15, 6, 1},
         {"edge_of_flight_line", kUint8, 15, 7, 1},
         {"classification", kUint8, 16},
         {"user_data", kUint8, 17},
         {"scan_angle", kInt16, 18},
         {"point_source_id", kUint16, 20},
         {"gps_time", kFloat64, 22}});
  } else {
    add({{"return_number", kUint8, 14, 0, 3},
         {"number_of_returns", kUint8, 14, 3, 3},
         {"scan_direction_flag", kUint8, 14, 6, 1},
         {"edge_of_flight_line", kUint8, 14, 7, 1},
         {"classification", kUint8, 15, 0, 5},
         {"synthetic", kUint8, 15, 5, 1},
         {"key_point", kUint8, 15, 6, 1},
         {"withheld", kUint8, 15, 7, 1},
         {"scan_angle_rank", kInt8, 16},
         {"user_data", kUint8, 17},
         {"point_source_id", kUint16, 18}});
    if (layout.timed()) add({{"gps_time", kFloat64, 20}});
  }
  std::size_t at = layout.base();
  if (layout.colored()) {
    add({{"red", kUint16, at}, {"green", kUint16, at + 2}, {"blue", kUint16, at + 4}});
    at += 6;
  }
  if (layout.infrared()) {
    add({{"nir", kUint16, at}});
    at += 2;
  }
  if (layout.waves()) {
    add({{"wave_packet_index", kUint8, at},
         {"wave_packet_size", kUint32, at + 9},
         {"wave_return_location", kFloat32, at + 13},
         {"wave_x", kFloat32, at + 17},
         {"wave_y", kFloat32, at + 21},
         {"wave_z", kFloat32, at + 25}});
  }
  return fields;
}

LasLayout::LasLayout(const LasHeader& header, const std::string& file)
    : scale_(header.storage.scale),
      offset_(header.storage.offset),
      point_(header.record),
      color_(las_color_offset(header.storage.point_format)),
      stride_(kPosition + point_ - kKept) {
  columns_ = {{"x", kFloat64, 0}, {"y", kFloat64, 8}, {"z", kFloat64, 16}};
  add_fields(header.storage.point_format);
  add_extra(header);
  require_few(columns_.size(), "values of a point",
              [&](const std::string& message) { throw_input(file, message); });
}

/// Adds a column; a name that is taken, case aside, gets a number.
void LasLayout::add(std::string name, ScalarType type, std::size_t offset) {
  const auto lower = [](std::string text) {
    std::transform(text.begin(), text.end(), text.begin(), [](unsigned char c) {
      return c >= 'A' && c <= 'Z' ? static_cast<char>(c + ('a' - 'A')) : static_cast<char>(c);
    });
    return text;
  };
  int& number = names_[lower(name)];
  if (++number > 1) {
    while (names_.contains(lower(fmt::format("{}_{}", name, number)))) ++number;
    name += fmt::format("_{}", number);
    names_[lower(name)] = 1;
  }
  columns_.push_back({std::move(name), type, offset});
}

void LasLayout::add_made(const std::string& name, ScalarType type, Made made) {
  made.to = stride_;
  add(name, type, stride_);
  stride_ += scalar_size(type);
  made_.push_back(made);
}

void LasLayout::add_fields(int point_format) {
  for (const LasField& field : las_fields(point_format)) {
    if (field.bits == 0) {
      add(field.name, field.type, field.offset + kPosition - kKept);
      continue;
    }
    add_made(field.name, field.type,
             {.from = kUint8,
              .shift = field.shift,
              .mask = (1U << static_cast<unsigned>(field.bits)) - 1,
              .at = field.offset});
  }
  for (const RecordColumn& column : columns_) {
    if (column.name != "wave_packet_index") continue;
    add_made("wave_packet_offset", kFloat64,
             {.from = kUint8, .wide = true, .at = column.offset - (kPosition - kKept) + 1});
    break;
  }
}

/// Adds the values of one description, which may be a vector of three; its bytes begin at `at` of
/// a point.
void LasLayout::add_described(const std::string& description, std::size_t& at, std::size_t end) {
  const auto type = static_cast<unsigned char>(description[2]);
  const auto options = static_cast<unsigned char>(description[3]);
  const std::string name = column_name(std::string_view(description).substr(4, 32));
  const bool known = type >= 1 && type <= 30;
  const std::size_t values = known ? (type - 1U) / 10 + 1 : options;
  const ScalarType from = known ? kExtraTypes[(type - 1U) % 10] : kUint8;
  const bool wide = known && ((type - 1U) % 10 == 6 || (type - 1U) % 10 == 7);
  const std::size_t size = wide ? 8 : scalar_size(from);
  for (std::size_t k = 0; k < values && at + size <= end; ++k, at += size) {
    const std::string own = name.empty() ? "extra" : name;
    const std::string column = values > 1 || name.empty() ? fmt::format("{}_{}", own, k) : own;
    Made made{.from = from, .wide = wide, .at = at};
    const auto number = [&](std::size_t place) {
      double value;
      std::memcpy(&value, description.data() + place + std::min<std::size_t>(k, 2) * 8, 8);
      return value;
    };
    const bool scaled = known && (options & 8) != 0;
    const bool shifted = known && (options & 16) != 0;
    if (scaled) made.scale = number(112);
    if (shifted) made.offset = number(136);
    if (scaled || shifted || wide) {
      add_made(column, kFloat64, made);
    } else {
      add(column, from, at + kPosition - kKept);
    }
  }
}

void LasLayout::add_extra(const LasHeader& header) {
  std::size_t at = header.layout().format_bytes();
  for (std::size_t k = 0; k + kDescription <= header.extra.size() && at < point_;
       k += kDescription) {
    add_described(header.extra.substr(k, kDescription), at, point_);
  }
  for (std::size_t k = 0; at < point_ && columns_.size() <= kMostColumns; ++k, ++at) {
    add(fmt::format("extra_{}", k), kUint8, at + kPosition - kKept);
  }
}

std::uint16_t LasLayout::expand(const std::byte* points, std::size_t count,
                                std::byte* records) const {
  int brightest = 0;
  for (std::size_t i = 0; i < count; ++i, points += point_, records += stride_) {
    for (std::size_t k = 0; k < 3; ++k) {
      const auto axis = static_cast<Eigen::Index>(k);
      const double value =
          load_scalar<std::int32_t, false>(points + 4 * k) * scale_[axis] + offset_[axis];
      std::memcpy(records + 8 * k, &value, sizeof(value));
    }
    std::memcpy(records + kPosition, points + kKept, point_ - kKept);
    if (color_ > 0) {
      for (std::size_t k = 0; k < 3; ++k) {
        brightest =
            std::max<int>(brightest, load_scalar<std::uint16_t, false>(points + color_ + 2 * k));
      }
    }
    for (const Made& made : made_) {
      if (made.mask != 0) {
        const auto bits = std::to_integer<unsigned>(points[made.at]);
        records[made.to] = static_cast<std::byte>((bits >> made.shift) & made.mask);
        continue;
      }
      double number = 0;
      if (made.wide) {
        number = made.from == kUint8
                     ? static_cast<double>(load_scalar<std::uint64_t, false>(points + made.at))
                     : static_cast<double>(load_scalar<std::int64_t, false>(points + made.at));
      } else {
        visit_type(made.from, [&]<class T>(T) {
          number = static_cast<double>(load_scalar<T, false>(points + made.at));
        });
      }
      number = number * made.scale + made.offset;
      std::memcpy(records + made.to, &number, sizeof(number));
    }
  }
  return static_cast<std::uint16_t>(brightest);
}

}  // namespace surfel
