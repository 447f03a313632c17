#pragma once

#include <algorithm>
#include <bit>
#include <cstdint>
#include <cstring>
#include <string>
#include <vector>

#include <fmt/format.h>
#include <surfel/base/crc32c.h>

namespace surfel::test {

/// The contents of E57 pages with their checksums in between, the last page filled up by zeros, and
/// the file's size in the header where it has one.
inline std::string with_checksums(std::string contents) {
  constexpr std::size_t kPayload = 1020;
  contents.resize((contents.size() + kPayload - 1) / kPayload * kPayload);
  const std::uint64_t size = contents.size() / kPayload * 1024;
  if (contents.size() >= 24) std::memcpy(contents.data() + 16, &size, sizeof(size));
  std::string file;
  for (std::size_t at = 0; at < contents.size(); at += kPayload) {
    const std::string page = contents.substr(at, kPayload);
    const std::uint32_t check = crc32c(std::as_bytes(std::span(page)));
    file += page;
    for (int shift = 24; shift >= 0; shift -= 8) {
      file += static_cast<char>(check >> static_cast<unsigned>(shift) & 255U);
    }
  }
  return file;
}

/// An E57 file as another program writes it.
class E57FileMaker {
 public:
  /// A field, and a value of each point as its bits stand in the stream.
  struct Field {
    std::string xml;  ///< An element of the prototype.
    unsigned bits;
    std::vector<std::uint64_t> values;
  };

  /// Adds the points of a scan in packets of at most `most` bytes a field, and returns the element
  /// `points` that describes them.
  std::string points(const std::vector<Field>& fields, std::size_t most = 1 << 12) {
    contents_.resize((contents_.size() + 3) / 4 * 4);
    const std::size_t section = contents_.size();
    contents_.resize(section + 32);
    contents_[section] = 1;
    put(section + 16, physical(contents_.size()));
    packet(0, std::string(12, '\0'));  // An index of packets, which readers need not read.
    std::vector<std::string> streams;
    std::string prototype;
    for (const Field& field : fields) {
      streams.push_back(packed(field));
      prototype += field.xml;
    }
    for (std::size_t at = 0; std::any_of(streams.begin(), streams.end(),
                                         [&](const std::string& s) { return at < s.size(); });
         at += most) {
      std::string body(2 + 2 * streams.size(), '\0');
      put_at(body, 0, static_cast<std::uint16_t>(streams.size()));
      for (std::size_t f = 0; f < streams.size(); ++f) {
        const std::string part = at < streams[f].size() ? streams[f].substr(at, most) : "";
        put_at(body, 2 + 2 * f, static_cast<std::uint16_t>(part.size()));
        body += part;
      }
      packet(1, body);
      packet(2, std::string(4, '\0'));  // A packet to be ignored.
    }
    put(section + 8, contents_.size() - section);
    return fmt::format(
        R"(<points type="CompressedVector" fileOffset="{}" recordCount="{}"><prototype type="Structure">{}</prototype><codecs type="Vector"></codecs></points>)",
        physical(section), fields.empty() ? 0 : fields.front().values.size(), prototype);
  }

  /// The file of scans, each the contents of a vectorChild of data3D.
  std::string file(const std::vector<std::string>& scans) const {
    std::string xml = R"(<?xml version="1.0" encoding="UTF-8"?><e57Root type="Structure"><data3D>)";
    for (const std::string& scan : scans) xml += "<vectorChild>" + scan + "</vectorChild>";
    return file_of_xml(xml + "</data3D></e57Root>");
  }
  std::string file_of_xml(const std::string& xml) const { return with_checksums(contents(xml)); }
  /// What the pages of the file hold.
  std::string contents(const std::string& xml) const {
    std::string all = contents_ + xml;
    all.replace(0, 8, "ASTM-E57");
    put_at(all, 8, std::uint32_t{1});
    put_at(all, 24, physical(contents_.size()));
    put_at(all, 32, std::uint64_t{xml.size()});
    put_at(all, 40, std::uint64_t{1024});
    return all;
  }

 private:
  template <class T>
  static void put_at(std::string& to, std::size_t at, T value) {
    std::memcpy(to.data() + at, &value, sizeof(value));
  }
  void put(std::size_t at, std::uint64_t value) { put_at(contents_, at, value); }
  static std::uint64_t physical(std::size_t at) { return at / 1020 * 1024 + at % 1020; }

  static std::string packed(const Field& field) {
    std::string bytes((field.values.size() * field.bits + 7) / 8, '\0');
    std::size_t at = 0;
    for (const std::uint64_t value : field.values) {
      for (unsigned bit = 0; bit < field.bits; ++bit, ++at) {
        if ((value >> bit & 1) != 0) bytes[at / 8] |= static_cast<char>(1U << at % 8);
      }
    }
    return bytes;
  }

  void packet(char type, const std::string& body) {
    const std::size_t size = (4 + body.size() + 3) / 4 * 4;
    const std::size_t at = contents_.size();
    contents_.resize(at + size);
    contents_[at] = type;
    put_at(contents_, at + 2, static_cast<std::uint16_t>(size - 1));
    contents_.replace(at + 4, body.size(), body);
  }

  std::string contents_ = std::string(48, '\0');
};

}  // namespace surfel::test
