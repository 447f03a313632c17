#pragma once

#include <cstddef>
#include <cstdint>
#include <cstring>

namespace surfel {

/// Scalar types of a file's columns.
enum class ScalarType : std::uint8_t {
  kInt8,
  kUint8,
  kInt16,
  kUint16,
  kInt32,
  kUint32,
  kFloat32,
  kFloat64
};

/// Bytes of one value.
constexpr std::size_t scalar_size(ScalarType type) {
  constexpr std::size_t kSizes[] = {1, 1, 2, 2, 4, 4, 4, 8};
  return kSizes[static_cast<std::size_t>(type)];
}

/// Calls visit(T{}) with the C++ type, so that a loop is specialised once per column, not per
/// value.
template <class Visit>
decltype(auto) visit_type(ScalarType type, Visit&& visit) {
  switch (type) {
    case ScalarType::kInt8:
      return visit(std::int8_t{});
    case ScalarType::kUint8:
      return visit(std::uint8_t{});
    case ScalarType::kInt16:
      return visit(std::int16_t{});
    case ScalarType::kUint16:
      return visit(std::uint16_t{});
    case ScalarType::kInt32:
      return visit(std::int32_t{});
    case ScalarType::kUint32:
      return visit(std::uint32_t{});
    case ScalarType::kFloat32:
      return visit(float{});
    case ScalarType::kFloat64:
      break;
  }
  return visit(double{});
}

/// Reads `count` consecutive values in this machine's byte order, at an address of any alignment.
inline void load_scalars(ScalarType type, const std::byte* from, std::size_t count, double* to) {
  visit_type(type, [&]<class T>(T value) {
    for (std::size_t i = 0; i < count; ++i) {
      std::memcpy(&value, from + i * sizeof(T), sizeof(T));
      to[i] = static_cast<double>(value);
    }
  });
}

}  // namespace surfel
