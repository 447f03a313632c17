#include <array>
#include <bit>
#include <string_view>

#include <fmt/format.h>
#include <surfel/base/error.h>
#include <surfel/io/mesh_builder.h>
#include <surfel/io/promises.h>
#include <surfel/io/record_table.h>
#include <surfel/io/stl.h>
#include <surfel/io/text_scanner.h>
#include <surfel/io/unique_vectors.h>

namespace surfel {
namespace {

constexpr std::size_t kHeaderBytes = 84;  // 80 of text, then the number of triangles.
constexpr std::size_t kRecordBytes = 50;  // Normal, three corners, 16 bits of attributes.
constexpr bool kSwapped = std::endian::native == std::endian::big;

std::size_t promised_triangles(std::span<const std::byte> bytes) {
  return load_scalar<std::uint32_t, kSwapped>(bytes.data() + kHeaderBytes - 4);
}

TriangleMesh finish(MeshBuilder& mesh, const UniqueVectors<3>& welded) {
  mesh.position.reserve(welded.values().size());
  for (const Vec3f& p : welded.values()) mesh.position.push_back(p.cast<double>());
  return mesh.finish();
}

TriangleMesh read_binary(const InputFile& file) {
  const std::span<const std::byte> bytes = file.bytes();
  const std::size_t count = promised_triangles(bytes);
  MeshBuilder mesh(file.name());
  UniqueVectors<3> welded;
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
      corner.vertex = welded.index_of(p);
    }
    mesh.add_polygon(corners);
  }
  return finish(mesh, welded);
}

/// Facets are read by their words `vertex` and `endloop`; the file must end a solid that it began.
TriangleMesh read_text(const InputFile& file) {
  MeshBuilder mesh(file.name());
  UniqueVectors<3> welded;
  TextScanner in(file.name(), as_text(file.bytes()), kMeshText);
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
      const Vec3d p(x, y, in.number("z of a vertex"));
      corners.push_back({.vertex = welded.index_of(p.cast<float>())});
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
  return finish(mesh, welded);
}

}  // namespace

TriangleMesh read_stl(const InputFile& file) {
  const std::span<const std::byte> bytes = file.bytes();
  const std::string_view text = as_text(bytes);
  const bool has_header = bytes.size() >= kHeaderBytes;
  const std::size_t needed =
      has_header ? kHeaderBytes + promised_triangles(bytes) * kRecordBytes : kHeaderBytes;
  // Some writers start binary files with "solid", too: there only the size tells.
  if (has_header && bytes.size() == needed) return read_binary(file);
  if (text.starts_with("solid")) return read_text(file);
  if (!has_header) {
    throw_input(file.name(), fmt::format("{} bytes are no STL, whose header alone has {}; it is "
                                         "truncated or has another format",
                                         bytes.size(), kHeaderBytes));
  }
  require_room(promised_triangles(bytes), kRecordBytes, bytes.size() - kHeaderBytes, kTheHeader,
               "triangles", [&](const std::string& message) { throw_input(file.name(), message); });
  return read_binary(file);
}

}  // namespace surfel
