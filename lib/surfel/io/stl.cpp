#include <bit>
#include <cmath>
#include <cstring>
#include <string_view>
#include <unordered_map>

#include <fmt/format.h>
#include <surfel/base/error.h>
#include <surfel/io/line_scanner.h>
#include <surfel/io/mesh_builder.h>
#include <surfel/io/record_table.h>
#include <surfel/io/stl.h>

namespace surfel {
namespace {

constexpr std::size_t kHeaderBytes = 84;  // 80 of text, then the number of triangles.
constexpr std::size_t kRecordBytes = 50;  // Normal, three corners, 16 bits of attributes.
constexpr bool kSwapped = std::endian::native == std::endian::big;

/// Gives corners at the same position the same vertex.
class Welder {
 public:
  explicit Welder(MeshBuilder& mesh) : mesh_(mesh) {}

  MeshBuilder::Corner corner(const Vec3f& p) {
    const Vec3f key = p + Vec3f::Zero();  // -0 and 0 are the same place.
    const auto next = static_cast<std::uint32_t>(mesh_.position.size());
    const auto [entry, added] = index_.try_emplace({key.x(), key.y(), key.z()}, next);
    if (added) mesh_.position.push_back(key.cast<double>());
    return {.vertex = entry->second};
  }

 private:
  struct Hash {
    std::size_t operator()(const std::array<float, 3>& p) const {
      std::uint64_t h = 0;
      for (const float c : p) {
        h = (h ^ std::bit_cast<std::uint32_t>(c)) * 0x9E3779B97F4A7C15U;
        h ^= h >> 32;
      }
      return h;
    }
  };

  MeshBuilder& mesh_;
  std::unordered_map<std::array<float, 3>, std::uint32_t, Hash> index_;
};

std::size_t promised_triangles(std::span<const std::byte> bytes) {
  return load_scalar<std::uint32_t, kSwapped>(bytes.data() + kHeaderBytes - 4);
}

TriangleMesh read_binary(const InputFile& file) {
  const std::span<const std::byte> bytes = file.bytes();
  const std::size_t count = promised_triangles(bytes);
  MeshBuilder mesh(file.name());
  Welder welder(mesh);
  for (std::size_t i = 0; i < count; ++i) {
    const std::byte* at = bytes.data() + kHeaderBytes + i * kRecordBytes + 3 * sizeof(float);
    std::array<MeshBuilder::Corner, 3> corners;
    for (MeshBuilder::Corner& corner : corners) {
      Vec3f p;
      for (float& coordinate : p) {
        coordinate = load_scalar<float, kSwapped>(at);
        at += sizeof(float);
      }
      if (!p.allFinite()) {
        throw_input(file.name(), fmt::format("a coordinate of face {} is not a finite number", i));
      }
      corner = welder.corner(p);
    }
    mesh.add_polygon(corners);
  }
  return mesh.finish();
}

/// Facets are read by their words `vertex` and `endloop`; the file must end a solid that it began.
TriangleMesh read_text(const InputFile& file) {
  MeshBuilder mesh(file.name());
  Welder welder(mesh);
  LineScanner in(file);
  std::vector<MeshBuilder::Corner> corners;
  bool within_solid = false;
  for (; in.skip_to_content(); in.next_line()) {
    const std::string_view keyword = in.word();
    if (keyword == "solid") {
      within_solid = true;
    } else if (keyword == "endsolid") {
      within_solid = false;
    } else if (keyword == "vertex") {
      const double x = in.number("x of a vertex");
      const double y = in.number("y of a vertex");
      corners.push_back(welder.corner(Vec3d(x, y, in.number("z of a vertex")).cast<float>()));
    } else if (keyword == "endloop") {
      if (corners.size() < 3) {
        in.fail(fmt::format("a facet with {} corners; it needs three at least", corners.size()));
      }
      mesh.add_polygon(corners);
      corners.clear();
    }
  }
  if (within_solid) {
    in.fail_at(in.position(), "the file ends without 'endsolid'; it is truncated");
  }
  return mesh.finish();
}

}  // namespace

TriangleMesh read_stl(const InputFile& file) {
  const std::span<const std::byte> bytes = file.bytes();
  const std::string_view text(reinterpret_cast<const char*>(bytes.data()), bytes.size());
  const bool has_header = bytes.size() >= kHeaderBytes;
  const std::size_t needed =
      has_header ? kHeaderBytes + promised_triangles(bytes) * kRecordBytes : kHeaderBytes;
  // Some writers start binary files with "solid", too: there only the size tells.
  if (has_header && bytes.size() == needed) return read_binary(file);
  if (text.starts_with("solid")) return read_text(file);
  if (bytes.size() < needed) {
    throw_input(file.name(), fmt::format("{} bytes, but the header of a binary STL promises {}; it "
                                         "is truncated or no STL",
                                         bytes.size(), needed));
  }
  return read_binary(file);
}

}  // namespace surfel
