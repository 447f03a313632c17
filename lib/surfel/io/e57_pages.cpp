#include <algorithm>
#include <cstring>

#include <fmt/format.h>
#include <surfel/base/crc32c.h>
#include <surfel/base/error.h>
#include <surfel/io/e57_pages.h>
#include <surfel/io/record_table.h>

namespace surfel {

std::uint64_t E57Pages::logical(std::uint64_t physical, const char* what) const {
  const std::uint64_t page = physical / kPage;
  const std::uint64_t within = physical % kPage;
  if (page >= pages_ || within >= kPayload) {
    throw_input(file_.name(),
                fmt::format("has {} at byte {} of {}, where none can be; the file is damaged", what,
                            physical, pages_ * kPage));
  }
  return page * kPayload + within;
}

void E57Window::copy(std::uint64_t begin, std::size_t size, std::byte* to) {
  while (size > 0) {
    if (begin < begin_ || begin - begin_ >= held_) load(begin / E57Pages::kPayload);
    const auto skipped = static_cast<std::size_t>(begin - begin_);
    const std::size_t part = std::min(size, held_ - skipped);
    std::memcpy(to, bytes_.data() + skipped, part);
    begin += part;
    size -= part;
    to += part;
  }
}

void E57Window::load(std::uint64_t page) {
  const std::size_t count = std::min<std::uint64_t>(at_once_, pages_.pages() - page);
  const std::byte* from =
      pages_.file().read_at(page * E57Pages::kPage, count * E57Pages::kPage, scratch_);
  bytes_.resize(count * E57Pages::kPayload);
  held_ = 0;
  for (std::size_t i = 0; i < count; ++i, from += E57Pages::kPage) {
    // The checksum alone is stored with its highest byte first.
    const auto stored = load_scalar<std::uint32_t, true>(from + E57Pages::kPayload);
    if (crc32c({from, E57Pages::kPayload}) != stored) {
      throw_input(pages_.file().name(),
                  fmt::format("page {} of {}, bytes {} to {}, has a wrong checksum: the file is "
                              "damaged; copy or export it again",
                              page + i + 1, pages_.pages(), (page + i) * E57Pages::kPage,
                              (page + i + 1) * E57Pages::kPage - 1));
    }
    std::memcpy(bytes_.data() + i * E57Pages::kPayload, from, E57Pages::kPayload);
  }
  begin_ = page * E57Pages::kPayload;
  held_ = bytes_.size();
}

}  // namespace surfel
