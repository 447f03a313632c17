#pragma once

// What headers of files promise, checked before memory is taken for it. Internal to the io module.

#include <cstdint>
#include <string>
#include <string_view>

#include <fmt/format.h>
#include <surfel/base/function_ref.h>

namespace surfel {

/// Calls fail(message) if `count` things of `least_bytes` bytes or more each do not fit into the
/// `bytes` that are left of a file. `promiser` names what counts them ("the header"), `things` what
/// they are ("points").
template <class Fail>
void require_room(std::uint64_t count, std::uint64_t least_bytes, std::uint64_t bytes,
                  FunctionRef<std::string()> promiser, std::string_view things, const Fail& fail) {
  if (least_bytes == 0 || count <= bytes / least_bytes) return;
  fail(
      fmt::format("{} promises {} {}, the file has room for {} at most; it is truncated or its "
                  "header is wrong",
                  promiser(), count, things, bytes / least_bytes));
}

/// The promiser of most counts.
inline constexpr auto kTheHeader = [] { return std::string("the header"); };

/// Columns of a table, fields of a point, properties of an element, elements of a header: no
/// program writes as many. Columns are found by their names one by one, which takes the square of
/// their number.
constexpr std::size_t kMostColumns = 8192;

/// Calls fail(message) for more than kMostColumns; `columns` names them ("properties of vertex").
template <class Fail>
void require_few(std::uint64_t count, std::string_view columns, const Fail& fail) {
  if (count <= kMostColumns) return;
  fail(fmt::format("more than {} {} are not supported; leave some out", kMostColumns, columns));
}

}  // namespace surfel
