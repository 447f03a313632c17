#pragma once

#include <array>
#include <bit>
#include <cstdint>
#include <type_traits>
#include <unordered_map>

#include <surfel/base/types.h>

namespace surfel {

/// Numbers vectors in the order of their first appearance. Equal vectors share a number; -0 equals
/// 0. Internal to the io module.
template <int kSize, class Scalar = float>
class UniqueVectors {
 public:
  using Vector = Eigen::Matrix<Scalar, kSize, 1>;

  std::uint32_t index_of(const Vector& v) {
    Key key;
    for (int k = 0; k < kSize; ++k) key[k] = v[k] + Scalar{0};  // Turns -0 into 0.
    const auto next = static_cast<std::uint32_t>(values_.size());
    const auto [entry, added] = index_.try_emplace(key, next);
    if (added) values_.push_back(v);
    return entry->second;
  }
  const Array<Vector>& values() const { return values_; }

 private:
  using Key = std::array<Scalar, kSize>;
  using Bits = std::conditional_t<sizeof(Scalar) == 4, std::uint32_t, std::uint64_t>;

  struct Hash {
    std::size_t operator()(const Key& key) const {
      std::uint64_t h = 0;
      for (const Scalar c : key) {
        h = (h ^ std::bit_cast<Bits>(c)) * 0x9E3779B97F4A7C15U;
        h ^= h >> 32;
      }
      return h;
    }
  };

  std::unordered_map<Key, std::uint32_t, Hash> index_;
  Array<Vector> values_;
};

}  // namespace surfel
