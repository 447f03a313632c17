#pragma once

#include <array>
#include <bit>
#include <cstdint>
#include <unordered_map>

#include <surfel/base/types.h>

namespace surfel {

/// Numbers vectors in the order of their first appearance. Equal vectors share a number; -0 equals
/// 0. Internal to the io module.
template <int kSize>
class UniqueVectors {
 public:
  using Vector = Eigen::Matrix<float, kSize, 1>;

  std::uint32_t index_of(const Vector& v) {
    std::array<float, kSize> key;
    for (int k = 0; k < kSize; ++k) key[k] = v[k] + 0.0F;  // Turns -0 into 0.
    const auto next = static_cast<std::uint32_t>(values_.size());
    const auto [entry, added] = index_.try_emplace(key, next);
    if (added) values_.push_back(v);
    return entry->second;
  }
  const Array<Vector>& values() const { return values_; }

 private:
  struct Hash {
    std::size_t operator()(const std::array<float, kSize>& key) const {
      std::uint64_t h = 0;
      for (const float c : key) {
        h = (h ^ std::bit_cast<std::uint32_t>(c)) * 0x9E3779B97F4A7C15U;
        h ^= h >> 32;
      }
      return h;
    }
  };

  std::unordered_map<std::array<float, kSize>, std::uint32_t, Hash> index_;
  Array<Vector> values_;
};

}  // namespace surfel
