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

/// The path that a URI means, with its percent codes decoded; paths of Windows are left as they
/// are. Nullopt where the URI is of another scheme than "file:", such as "https:", or no path.
std::optional<std::string> path_of_uri(std::string_view uri);

}  // namespace surfel
