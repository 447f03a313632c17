#include <charconv>

#include <fmt/format.h>
#include <surfel/base/error.h>
#include <surfel/texture/named_frequency.h>

namespace surfel {

NamedFrequency parse_named_frequency(const char* field, const std::string& text, double least,
                                     double most) {
  const std::size_t colon = text.find(':');
  NamedFrequency named{text.substr(0, colon)};
  if (colon == std::string::npos) return named;
  const char* begin = text.data() + colon + 1;
  const char* end = text.data() + text.size();
  if (begin == end) {
    throw_usage(fmt::format("`{}` is {}; a frequency must follow the colon", field, text));
  }
  const auto [stop, error] = std::from_chars(begin, end, named.frequency.emplace());
  if (error != std::errc{} || stop != end || !(*named.frequency >= least) ||
      !(*named.frequency <= most)) {
    throw_usage(fmt::format("`{}` is {}; the frequency must be a number from {} to {}", field, text,
                            least, most));
  }
  return named;
}

}  // namespace surfel
