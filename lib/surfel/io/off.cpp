#include <algorithm>
#include <array>

#include <fmt/format.h>
#include <surfel/base/color.h>
#include <surfel/base/error.h>
#include <surfel/io/mesh_builder.h>
#include <surfel/io/off.h>
#include <surfel/io/promises.h>
#include <surfel/io/text_scanner.h>

namespace surfel {
namespace {

class OffReader {
 public:
  explicit OffReader(const InputFile& file)
      : in_(file.name(), as_text(file.bytes()), kMeshText), mesh_(file.name()) {}

  TriangleMesh read() {
    read_keyword();
    constexpr std::size_t kShortestVertex = 6;  // "0 0 0\n"
    constexpr std::size_t kShortestFace = 8;    // "3 0 1 2\n"
    const std::size_t vertices = read_count("vertices", kShortestVertex);
    const std::size_t faces = read_count("faces", kShortestFace);
    if (!in_.at_line_end()) in_.integer("the number of edges");
    in_.next_line();
    for (std::size_t i = 0; i < vertices; ++i) read_vertex();
    decode_colors();
    for (std::size_t i = 0; i < faces; ++i) read_face();
    return mesh_.finish();
  }

 private:
  /// [ST][C][N]OFF; the keyword may be left out.
  void read_keyword() {
    require_content("the header");
    if (in_.peek_word().find_first_not_of("+-.0123456789") == std::string_view::npos) return;
    const std::string_view keyword = in_.word();
    std::string_view rest = keyword;
    const auto take = [&](std::string_view prefix) {
      if (!rest.starts_with(prefix)) return false;
      rest.remove_prefix(prefix.size());
      return true;
    };
    has_uv_ = take("ST");
    has_color_ = take("C");
    has_normal_ = take("N");
    if (rest != "OFF") {
      in_.fail(
          fmt::format("{} is not a kind of OFF that is supported (OFF, COFF, NOFF, STOFF and "
                      "their combinations in three dimensions)",
                      quoted_excerpt(keyword)));
    }
    if (in_.peek_word() == "BINARY") in_.fail("binary OFF is not supported");
  }

  void require_content(const char* what) {
    if (!in_.skip_to_content()) {
      in_.fail_at(in_.position(), fmt::format("the file ends within {}; it is truncated", what));
    }
  }

  std::size_t read_count(const char* what, std::size_t least_bytes) {
    require_content("the counts");
    const std::int64_t count = in_.integer("a count of the header");
    if (count < 0) in_.fail(fmt::format("the header promises {} {}", count, what));
    // The last line need not end.
    require_room(static_cast<std::uint64_t>(count), least_bytes, in_.remaining() + 1, kTheHeader,
                 what, [this](const std::string& message) { in_.fail(message); });
    return static_cast<std::size_t>(count);
  }

  Vec3d read_vector(const char* what) {
    const double x = in_.number(what);
    const double y = in_.number(what);
    return {x, y, in_.number(what)};
  }

  void read_vertex() {
    require_content("the vertices");
    mesh_.position.push_back(read_vector("a coordinate of a vertex"));
    if (has_normal_) mesh_.normal.push_back(read_vector("a normal").cast<float>());
    if (has_color_) mesh_.color.push_back(read_vector("a colour").cast<float>());
    if (has_uv_) read_uv();
    in_.next_line();
  }

  /// The last two numbers of the line: colours come with or without alpha before them.
  void read_uv() {
    double u = in_.number("a texture coordinate");
    double v = in_.number("a texture coordinate");
    while (!in_.at_line_end()) {
      u = v;
      v = in_.number("a texture coordinate");
    }
    mesh_.uv.emplace_back(static_cast<float>(u), static_cast<float>(v));
  }

  /// Colours are 0..255 or 0..1, which only their largest value tells; both are as displayed.
  void decode_colors() {
    float largest = 0;
    for (const Vec3f& c : mesh_.color) largest = std::max(largest, c.maxCoeff());
    const float scale = largest > 1 ? 1.0F / 255 : 1.0F;
    for (Vec3f& c : mesh_.color) {
      c = c.unaryExpr([&](float encoded) { return srgb_to_linear(encoded * scale); }).eval();
    }
  }

  void read_face() {
    require_content("the faces");
    const std::int64_t size = in_.integer("the number of corners of a face");
    if (size < 3) in_.fail(fmt::format("a face with {} corners; it needs three at least", size));
    corners_.clear();
    for (std::int64_t k = 0; k < size; ++k) {
      const std::int64_t vertex = in_.integer("an index of a face");
      if (vertex < 0 || static_cast<std::size_t>(vertex) >= mesh_.position.size()) {
        in_.fail(fmt::format("index {} is out of range; there are {} vertices, counted from 0",
                             vertex, mesh_.position.size()));
      }
      const auto index = static_cast<std::uint32_t>(vertex);
      corners_.push_back({.vertex = index,
                          .uv = has_uv_ ? index : MeshBuilder::kNone,
                          .normal = has_normal_ ? index : MeshBuilder::kNone});
    }
    mesh_.add_polygon(corners_);
    in_.next_line();
  }

  TextScanner in_;
  MeshBuilder mesh_;
  std::vector<MeshBuilder::Corner> corners_;
  bool has_uv_ = false;
  bool has_color_ = false;
  bool has_normal_ = false;
};

}  // namespace

TriangleMesh read_off(const InputFile& file) { return OffReader(file).read(); }

}  // namespace surfel
