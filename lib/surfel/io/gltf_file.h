#pragma once

#include <cstddef>
#include <cstdint>
#include <memory>
#include <span>
#include <string>
#include <string_view>
#include <unordered_map>
#include <vector>

#include <nlohmann/json.hpp>
#include <surfel/base/scalar_type.h>
#include <surfel/base/types.h>
#include <surfel/io/input_file.h>
#include <surfel/io/json_view.h>

namespace surfel {

/// The elements of a glTF accessor: vectors or matrices of the same size. Keeps views of the file's
/// bytes, or values of its own where they were compressed or are sparse. Internal to the io module.
class GltfAccessor {
 public:
  static constexpr std::size_t kMostComponents = 16;

  std::size_t size() const { return count_; }
  std::size_t components() const { return components_; }
  bool is_float() const { return type_ == ScalarType::kFloat32; }
  /// Writes components() values of an element, integers as fractions of full scale where the
  /// accessor says so.
  void read(std::size_t element, float* values) const;
  /// A component as the whole number that it is stored as.
  std::uint32_t integer(std::size_t element, std::size_t component = 0) const;

 private:
  friend class GltfFile;

  const std::byte* data_ = nullptr;
  std::size_t stride_ = 0;
  std::size_t count_ = 0;
  std::size_t components_ = 1;
  ScalarType type_ = ScalarType::kFloat32;
  bool normalized_ = false;
  std::shared_ptr<const Array<std::byte>> own_;  ///< What `data_` points into, or null.
};

/// A file of glTF 2.0 (Khronos, "glTF 2.0 specification"), as text with buffers beside it or as
/// GLB. Nothing is read that does not lie inside its buffer, and no more memory is taken than the
/// buffers' bytes bear out. Internal to the io module.
class GltfFile {
 public:
  /// Throws Error(kInput) where the file is no glTF 2.0, or requires extensions that are not known.
  explicit GltfFile(InputFile file);

  const std::string& name() const { return file_.name(); }
  JsonView root() const { return {json_, file_.name()}; }
  /// The element of one of the document's arrays ("meshes") that `reference` names by its number.
  JsonView referred(const char* array, const JsonView& reference) const;

  /// The elements of an element of accessors.
  GltfAccessor accessor(const JsonView& description);
  /// The bytes of an element of bufferViews, decompressed where they are compressed.
  std::span<const std::byte> view_bytes(const JsonView& view);

  /// Elements of a mesh's primitive that are compressed as a whole.
  struct Draco {
    std::unordered_map<std::string, GltfAccessor> attribute{};
    GltfAccessor indices{};
  };
  /// Decodes the named attributes of a KHR_draco_mesh_compression.
  Draco decode_draco(const JsonView& extension, std::span<const std::string_view> names);

  /// The path of the file that a URI names (named_path()). Throws Error(kInput) at `uri`'s place
  /// where it names no file.
  std::string path_of(const JsonView& uri) const;
  /// Bytes that all buffers have together, which are the measure of what may be built of them.
  std::size_t bytes() const { return bytes_; }

 private:
  struct Buffer {
    std::span<const std::byte> bytes;
    Array<std::byte> own;  ///< What `bytes` shows, unless it is this file.
    bool loaded = false;
  };

  std::string_view read_chunks();
  void check_extensions() const;
  std::span<const std::byte> buffer(const JsonView& reference);
  std::span<const std::byte> part(const JsonView& of);
  std::span<const std::byte> decompressed(const JsonView& view, const JsonView& extension);
  void locate(const JsonView& stored, GltfAccessor& values);
  void replace(const JsonView& sparse, GltfAccessor& values);

  InputFile file_;
  nlohmann::json json_;
  std::span<const std::byte> chunk_;  ///< GLB's binary part.
  std::vector<Buffer> buffer_;
  std::unordered_map<std::string, Array<std::byte>> decompressed_;  ///< By the view's place.
  std::unordered_map<std::string, GltfAccessor> sparse_;            ///< By the accessor's place.
  std::size_t bytes_ = 0;
};

}  // namespace surfel
