#pragma once

#include <algorithm>
#include <cstddef>
#include <cstring>
#include <type_traits>
#include <utility>
#include <vector>

#include <surfel/base/export.h>

namespace surfel {

using Bytes = std::vector<std::byte>;

/// Processes, or threads, that work together on what each holds a part of. All of them call the
/// functions below in the same order.
class SURFEL_API Peers {
 public:
  virtual ~Peers() = default;
  Peers() = default;
  Peers(const Peers&) = delete;
  Peers& operator=(const Peers&) = delete;

  /// The number of this one, from 0 on, and how many they are.
  virtual int rank() const = 0;
  virtual int count() const = 0;
  /// Sends bytes to each peer, by rank, and returns what each has sent to this one.
  virtual std::vector<Bytes> exchange(std::vector<Bytes> to) = 0;
};

/// Adds values to the end of bytes.
template <class T>
void append_values(const T* values, std::size_t count, Bytes& to) {
  static_assert(std::is_trivially_copyable_v<T>);
  const auto* const from = reinterpret_cast<const std::byte*>(values);
  to.insert(to.end(), from, from + count * sizeof(T));
}

/// The values that bytes hold.
template <class T>
std::vector<T> values_of(const Bytes& bytes) {
  static_assert(std::is_trivially_copyable_v<T>);
  std::vector<T> values(bytes.size() / sizeof(T));
  if (!values.empty()) std::memcpy(values.data(), bytes.data(), values.size() * sizeof(T));
  return values;
}

/// The lists of all peers, by rank; of one alone (null) its own.
template <class T>
std::vector<std::vector<T>> gather_lists(Peers* peers, const std::vector<T>& mine) {
  if (!peers) return {mine};
  Bytes bytes;
  append_values(mine.data(), mine.size(), bytes);
  std::vector<std::vector<T>> all;
  for (const Bytes& from :
       peers->exchange(std::vector<Bytes>(static_cast<std::size_t>(peers->count()), bytes))) {
    all.push_back(values_of<T>(from));
  }
  return all;
}

/// The least of the peers' values.
template <class T>
T least_of(Peers* peers, const T& mine) {
  T least = mine;
  for (const std::vector<T>& values : gather_lists(peers, std::vector<T>{mine})) {
    least = std::min(least, values.front());
  }
  return least;
}

}  // namespace surfel
