#pragma once

#include <cstddef>
#include <optional>
#include <string>
#include <string_view>
#include <vector>

#include <surfel/base/export.h>

namespace surfel {

/// Bytes of a TOML text that is read; its tree takes some fifty times as many.
inline constexpr std::size_t kMostTomlBytes = std::size_t{4} << 20;

/// One `key = value` of a TOML text.
struct TomlSetting {
  std::string key;
  std::size_t line = 1;  ///< Where the key stands; the first line is 1.
  /// The value as a command line would have it ("true", "0.5"), or the elements of an array; unset
  /// for tables, dates, and arrays that hold such.
  std::optional<std::vector<std::string>> values;
};

/// The settings at the top of a TOML text, by key. Throws Error(kInput) naming `file` and line for
/// text that is no TOML, for more than kMostTomlBytes, for keys of more than 32 parts, and for
/// values in more than 32 others.
SURFEL_API std::vector<TomlSetting> read_toml_settings(std::string_view text,
                                                       const std::string& file);

}  // namespace surfel
