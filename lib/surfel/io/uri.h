#pragma once

#include <cstddef>
#include <optional>
#include <string>
#include <string_view>

#include <surfel/base/types.h>

namespace surfel {

// URIs as files have them that name others (RFC 3986, RFC 2397). Internal to the io module.

/// Is the URI data itself, "data:..."?
bool is_data_uri(std::string_view uri);

/// The bytes of a data URI; nullopt where it is not in base64, or damaged.
std::optional<Array<std::byte>> decode_data_uri(std::string_view uri);

/// The path that a relative URI means: percent codes are decoded and backslashes, which some
/// programs write, turned. Nullopt where the URI has a scheme such as "https:", is absolute, or
/// leads out of the folder that it starts from: a file that somebody sends must not reach others.
std::optional<std::string> relative_path(std::string_view uri);

}  // namespace surfel
