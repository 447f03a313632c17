#include <surfel/base/error.h>

namespace surfel {
namespace {

std::string without_nul(std::string message) {
  for (std::size_t at = 0; (at = message.find('\0', at)) != std::string::npos;) {
    message.replace(at, 1, "\\0");
  }
  return message;
}

}  // namespace

Error::Error(ErrorKind kind, const std::string& message)
    : std::runtime_error(without_nul(message)), kind_(kind) {}

}  // namespace surfel
