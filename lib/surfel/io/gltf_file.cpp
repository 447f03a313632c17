// Khronos, "glTF 2.0 specification", and the extensions that kExtensions names.

#include <algorithm>
#include <bit>
#include <limits>

#include <fmt/format.h>
#include <surfel/base/error.h>
#include <surfel/base/plugin.h>
#include <surfel/io/gltf_file.h>
#include <surfel/io/gltf_plugin.h>
#include <surfel/io/named_file.h>
#include <surfel/io/promises.h>
#include <surfel/io/record_table.h>
#include <surfel/io/text_scanner.h>
#include <surfel/io/uri.h>

namespace surfel {
namespace {

constexpr std::size_t kGlbHeaderBytes = 12;  // Magic, version, length.
constexpr std::size_t kChunkHeaderBytes = 8;
constexpr std::uint32_t kJsonChunk = 0x4E4F534A;
constexpr std::uint32_t kBinaryChunk = 0x004E4942;
constexpr bool kSwappedGltf = std::endian::native == std::endian::big;

/// A byte of compressed attributes stands for at most so many bytes: meshopt's codec spends two
/// bits or more on sixteen bytes, which is a ratio of 64. A file that claims more than the constant
/// is refused before anything is allocated.
constexpr std::uint64_t kMostAttributeRatio = 256;

/// Extensions without which a file may not be read, and that are. Others of materials
/// (KHR_materials_...) change what light does at a surface, which is not taken over from meshes.
constexpr std::array<std::string_view, 11> kExtensions = {
    "EXT_mesh_gpu_instancing", "EXT_meshopt_compression", "KHR_meshopt_compression",
    "EXT_texture_webp",        "KHR_animation_pointer",   "KHR_draco_mesh_compression",
    "KHR_lights_punctual",     "KHR_mesh_quantization",   "KHR_texture_transform",
    "KHR_xmp_json_ld",         "KHR_node_visibility"};
constexpr std::string_view kMaterialExtensions = "KHR_materials_";

std::uint32_t load_u32(std::span<const std::byte> bytes, std::size_t at) {
  return load_scalar<std::uint32_t, kSwappedGltf>(bytes.data() + at);
}

std::size_t components_of(const JsonView& type) {
  const std::string name = type.text("");
  constexpr std::array<std::pair<std::string_view, std::size_t>, 5> kTypes = {
      {{"SCALAR", 1}, {"VEC2", 2}, {"VEC3", 3}, {"VEC4", 4}, {"MAT4", 16}}};
  for (const auto& [known, components] : kTypes) {
    if (name == known) return components;
  }
  type.fail(
      fmt::format("is {}, and must be SCALAR, VEC2, VEC3, VEC4 or MAT4", quoted_excerpt(name)));
}

/// OpenGL's numbers.
ScalarType scalar_of(const JsonView& component_type) {
  switch (component_type.count()) {
    case 5120:
      return ScalarType::kInt8;
    case 5121:
      return ScalarType::kUint8;
    case 5122:
      return ScalarType::kInt16;
    case 5123:
      return ScalarType::kUint16;
    case 5125:
      return ScalarType::kUint32;
    case 5126:
      return ScalarType::kFloat32;
    default:
      component_type.fail(
          fmt::format("is {}, and must be 5120 to 5126, but not 5124", component_type.count()));
  }
}

MeshoptWork::Mode mode_of(const JsonView& mode) {
  const std::string name = mode.text("");
  if (name == "ATTRIBUTES") return MeshoptWork::Mode::kAttributes;
  if (name == "TRIANGLES") return MeshoptWork::Mode::kTriangles;
  if (name == "INDICES") return MeshoptWork::Mode::kIndices;
  mode.fail(
      fmt::format("is {}, and must be ATTRIBUTES, TRIANGLES or INDICES", quoted_excerpt(name)));
}

MeshoptWork::Filter filter_of(const JsonView& filter) {
  const std::string name = filter.text("NONE");
  if (name == "NONE") return MeshoptWork::Filter::kNone;
  if (name == "OCTAHEDRAL") return MeshoptWork::Filter::kOctahedral;
  if (name == "QUATERNION") return MeshoptWork::Filter::kQuaternion;
  if (name == "EXPONENTIAL") return MeshoptWork::Filter::kExponential;
  filter.fail(fmt::format("is {}, and must be NONE, OCTAHEDRAL, QUATERNION or EXPONENTIAL",
                          quoted_excerpt(name)));
}

/// Is the number of bytes an element one that the codec has?
bool has_stride(const MeshoptWork& work) {
  if (work.mode != MeshoptWork::Mode::kAttributes) {
    return (work.stride == 2 || work.stride == 4) && work.filter == MeshoptWork::Filter::kNone;
  }
  switch (work.filter) {
    case MeshoptWork::Filter::kOctahedral:
      return work.stride == 4 || work.stride == 8;
    case MeshoptWork::Filter::kQuaternion:
      return work.stride == 8;
    default:
      return work.stride > 0 && work.stride <= 256 && work.stride % 4 == 0;
  }
}

/// Elements that the codec can make of so many bytes: a triangle takes one byte at least, and so
/// does an index of a sequence.
std::uint64_t most_elements(const MeshoptWork& work) {
  switch (work.mode) {
    case MeshoptWork::Mode::kTriangles:
      return 3 * work.coded.size();
    case MeshoptWork::Mode::kIndices:
      return work.coded.size();
    default:
      return kMostAttributeRatio * work.coded.size() / work.stride;
  }
}

/// A function of the plug-in.
void* decoder(const JsonView& extension, const char* symbol) {
  if (!has_plugin("gltf")) {
    extension.fail("cannot be decoded without a plug-in; " + plugin_advice("gltf") +
                   ", or export the file without compression");
  }
  return plugin_symbol("gltf", symbol);
}

template <class T>
float fraction_of(T value) {
  // The least of signed integers would be below -1.
  return std::max(-1.0F,
                  static_cast<float>(value) / static_cast<float>(std::numeric_limits<T>::max()));
}

}  // namespace

void GltfAccessor::read(std::size_t element, float* values) const {
  const std::byte* at = data_ + element * stride_;
  visit_type(type_, [&](auto tag) {
    using T = decltype(tag);
    for (std::size_t i = 0; i < components_; ++i, at += sizeof(T)) {
      const T value = load_scalar<T, kSwappedGltf>(at);
      if constexpr (std::is_integral_v<T>) {
        values[i] = normalized_ ? fraction_of(value) : static_cast<float>(value);
      } else {
        values[i] = static_cast<float>(value);
      }
    }
  });
}

std::uint32_t GltfAccessor::integer(std::size_t element, std::size_t component) const {
  return visit_type(type_, [&](auto tag) {
    using T = decltype(tag);
    const T value = load_scalar<T, kSwappedGltf>(data_ + element * stride_ + component * sizeof(T));
    if constexpr (std::is_floating_point_v<T>) {
      // A joint or an index as a float, which some programs write.
      return value >= 0 && value < 0x1p32F ? static_cast<std::uint32_t>(value)
                                           : std::numeric_limits<std::uint32_t>::max();
    } else {
      return static_cast<std::uint32_t>(value);
    }
  });
}

GltfFile::GltfFile(InputFile file) : file_(std::move(file)) {
  json_ = parse_json(read_chunks(), name());
  const JsonView version = root()["asset"]["version"];
  const std::string text = version.text("");
  if (!text.starts_with("2.")) {
    version.fail(
        fmt::format("is {}; only glTF 2.0 is read, export the file as that", quoted_excerpt(text)));
  }
  check_extensions();
  const std::size_t buffers = root()["buffers"].size();
  buffer_.resize(buffers);
  bytes_ = file_.size();
}

/// The document's text; sets `chunk_`.
std::string_view GltfFile::read_chunks() {
  const std::span<const std::byte> all = file_.bytes();
  if (!as_text(all).starts_with("glTF")) return as_text(all);
  const auto truncated = [&](std::uint64_t needed) {
    throw_input(name(), fmt::format("{} bytes are needed, the file has {}; it is truncated or "
                                    "damaged, export it again",
                                    needed, all.size()));
  };
  if (all.size() < kGlbHeaderBytes) truncated(kGlbHeaderBytes);
  const std::uint32_t version = load_u32(all, 4);
  if (version != 2) {
    throw_input(name(), fmt::format("is GLB of version {}; only version 2 is read", version));
  }
  const std::size_t length = load_u32(all, 8);
  if (length > all.size()) truncated(length);
  std::string_view text;
  for (std::size_t at = kGlbHeaderBytes; at + kChunkHeaderBytes <= length;) {
    const std::size_t size = load_u32(all, at);
    const std::uint32_t type = load_u32(all, at + 4);
    at += kChunkHeaderBytes;
    if (size > length - at) truncated(at + size);
    const std::span<const std::byte> chunk = all.subspan(at, size);
    if (type == kJsonChunk && text.empty()) text = as_text(chunk);
    if (type == kBinaryChunk && chunk_.empty()) chunk_ = chunk;
    at += size;
  }
  if (text.empty()) throw_input(name(), "the GLB has no part with JSON; export it again");
  return text;
}

void GltfFile::check_extensions() const {
  const JsonView required = root()["extensionsRequired"];
  for (std::size_t i = 0; i < required.size(); ++i) {
    const std::string extension = required.at(i).text("");
    const bool known =
        extension.starts_with(kMaterialExtensions) ||
        std::find(kExtensions.begin(), kExtensions.end(), extension) != kExtensions.end();
    if (known) continue;
    throw_input(name(), fmt::format("needs the extension {}, which is not supported; export the "
                                    "file without it",
                                    quoted_excerpt(extension)));
  }
}

JsonView GltfFile::referred(const char* array, const JsonView& reference) const {
  const JsonView all = root()[array];
  const std::uint64_t index = reference.count();
  if (index < all.size()) return all.at(index);
  reference.fail(
      fmt::format("is {}, but there are {} {}; export the file again", index, all.size(), array));
}

std::string GltfFile::path_of(const JsonView& uri) const {
  const std::string text = uri.text("");
  const auto path = path_of_uri(text);
  if (!path) uri.fail(fmt::format("is {}; only files are read", quoted_excerpt(text)));
  return named_path(name(), *path);
}

/// Bytes of a buffer, as many as it promises.
std::span<const std::byte> GltfFile::buffer(const JsonView& reference) {
  const JsonView description = referred("buffers", reference);
  Buffer& found = buffer_[reference.count()];
  if (found.loaded) return found.bytes;
  const JsonView uri = description["uri"];
  if (!uri) {
    if (reference.count() != 0 || chunk_.empty()) {
      description.fail("names no file, and the file itself holds no bytes of it; export it again");
    }
    found.bytes = chunk_;
  } else {
    const std::string text = uri.text("");
    if (is_data_uri(text)) {
      auto decoded = decode_data_uri(text);
      if (!decoded) uri.fail("is no base64 data, or damaged; export the file again");
      found.own = std::move(*decoded);
    } else {
      const std::string path = path_of(uri);
      const std::string problem = named_problem(name(), path);
      if (!problem.empty()) {
        uri.fail(
            fmt::format("is {}, which {}; put it beside this file", quoted_excerpt(text), problem));
      }
      const InputFile beside = open_named(name(), path);
      const std::span<const std::byte> part = beside.head(description["byteLength"].count());
      found.own.assign(part.begin(), part.end());
      bytes_ += found.own.size();
    }
    found.bytes = found.own;
  }
  const std::uint64_t promised = description["byteLength"].count();
  if (promised > found.bytes.size()) {
    description.fail(
        fmt::format("has {} bytes, {} are promised; it is truncated, export the file "
                    "again",
                    found.bytes.size(), promised));
  }
  found.bytes = found.bytes.first(promised);
  found.loaded = true;
  return found.bytes;
}

/// The part of a buffer that `buffer`, `byteOffset` and `byteLength` name.
std::span<const std::byte> GltfFile::part(const JsonView& of) {
  const std::span<const std::byte> all = buffer(of["buffer"]);
  const std::uint64_t offset = of["byteOffset"].count(0);
  const std::uint64_t length = of["byteLength"].count();
  if (offset > all.size() || length > all.size() - offset) {
    of.fail(fmt::format("is {} bytes from {} on, but the buffer has {}; export the file again",
                        length, offset, all.size()));
  }
  return all.subspan(offset, length);
}

std::span<const std::byte> GltfFile::view_bytes(const JsonView& view) {
  for (const char* const name : {"EXT_meshopt_compression", "KHR_meshopt_compression"}) {
    const JsonView compressed = view["extensions"][name];
    if (compressed) return decompressed(view, compressed);
  }
  return part(view);
}

std::span<const std::byte> GltfFile::decompressed(const JsonView& view, const JsonView& extension) {
  const auto [entry, is_new] = decompressed_.try_emplace(view.place());
  if (!is_new) return entry->second;
  MeshoptWork work;
  work.coded = part(extension);
  work.mode = mode_of(extension["mode"]);
  work.filter = filter_of(extension["filter"]);
  work.count = extension["count"].count();
  work.stride = extension["byteStride"].count();
  if (!has_stride(work)) {
    extension["byteStride"].fail(fmt::format("of {} is not possible here", work.stride));
  }
  const bool whole = work.mode != MeshoptWork::Mode::kTriangles || work.count % 3 == 0;
  if (!whole || work.count > most_elements(work)) {
    extension["count"].fail(fmt::format("of {} is not possible for {} bytes; export the file again",
                                        work.count, work.coded.size()));
  }
  const auto decode = reinterpret_cast<MeshoptDecode>(decoder(extension, kMeshoptDecodeSymbol));
  entry->second.resize(work.count * work.stride);
  work.out = entry->second.data();
  if (work.count > 0 && !decode(work)) {
    extension.fail("is damaged, or of a version that is not known; export the file again");
  }
  bytes_ += entry->second.size();
  return entry->second;
}

/// Finds the elements, whose number and kind are known, by the place that `stored` tells.
void GltfFile::locate(const JsonView& stored, GltfAccessor& values) {
  const std::size_t element = values.components_ * scalar_size(values.type_);
  const JsonView view = referred("bufferViews", stored["bufferView"]);
  const std::span<const std::byte> bytes = view_bytes(view);
  const std::uint64_t offset = stored["byteOffset"].count(0);
  values.stride_ = view["byteStride"].count(element);
  if (values.stride_ < element) {
    view["byteStride"].fail(fmt::format("is {}, less than the {} bytes of an element of {}",
                                        values.stride_, element, stored.place()));
  }
  const std::uint64_t room = offset <= bytes.size() ? bytes.size() - offset : 0;
  // Nothing need follow the last element, whatever the stride.
  const std::uint64_t fit = room < element ? 0 : (room - element) / values.stride_ + 1;
  if (values.count_ > fit) {
    stored.fail(
        fmt::format("has {} elements, but {} has room for {}; the file is truncated or "
                    "damaged, export it again",
                    values.count_, view.place(), fit));
  }
  values.data_ = bytes.data() + offset;
}

/// Copies the elements and replaces some.
void GltfFile::replace(const JsonView& sparse, GltfAccessor& values) {
  GltfAccessor index;
  index.count_ = sparse["count"].count();
  index.type_ = scalar_of(sparse["indices"]["componentType"]);
  GltfAccessor replaced = values;
  replaced.count_ = index.count_;
  locate(sparse["indices"], index);
  locate(sparse["values"], replaced);
  const std::size_t element = values.components_ * scalar_size(values.type_);
  auto own = std::make_shared<Array<std::byte>>(values.count_ * element, std::byte{0});
  const auto copy = [&](const GltfAccessor& from, std::size_t i, std::size_t to) {
    std::copy_n(from.data_ + i * from.stride_, element, own->data() + to * element);
  };
  for (std::size_t i = 0; values.data_ && i < values.count_; ++i) copy(values, i, i);
  for (std::size_t i = 0; i < index.count_; ++i) {
    const std::uint32_t to = index.integer(i);
    if (to >= values.count_) {
      sparse.fail(fmt::format("replaces element {}, but there are {}; export the file again", to,
                              values.count_));
    }
    copy(replaced, i, to);
  }
  values.data_ = own->data();
  values.stride_ = element;
  values.own_ = std::move(own);
}

GltfAccessor GltfFile::accessor(const JsonView& description) {
  if (const auto known = sparse_.find(description.place()); known != sparse_.end()) {
    return known->second;
  }
  GltfAccessor values;
  values.count_ = description["count"].count();
  values.components_ = components_of(description["type"]);
  values.type_ = scalar_of(description["componentType"]);
  values.normalized_ = description["normalized"].flag(false);
  const JsonView sparse = description["sparse"];
  if (description["bufferView"]) {
    locate(description, values);
    if (!sparse) return values;
  } else {
    // Elements that are nowhere are zero.
    require_room(
        values.count_, 1, bytes_, [&] { return description.place(); }, "elements",
        [&](const std::string& message) { throw_input(name(), message); });
    if (!sparse) description["bufferView"].fail("is missing; export the file again");
  }
  replace(sparse, values);
  sparse_.emplace(description.place(), values);
  return values;
}

GltfFile::Draco GltfFile::decode_draco(const JsonView& extension,
                                       std::span<const std::string_view> names) {
  DracoWork work;
  work.coded = view_bytes(referred("bufferViews", extension["bufferView"]));
  std::vector<std::string_view> present;
  for (const std::string_view attribute : names) {
    const JsonView id = extension["attributes"][attribute];
    if (!id) continue;
    work.attribute.push_back({.id = static_cast<std::uint32_t>(id.count())});
    present.push_back(attribute);
  }
  const auto decode = reinterpret_cast<DracoDecode>(decoder(extension, kDracoDecodeSymbol));
  if (!decode(work)) extension.fail("is damaged; export the file again");
  const auto own = [](const auto& array, std::size_t components, ScalarType type) {
    const auto bytes = std::as_bytes(std::span(array.data(), array.size()));
    GltfAccessor values;
    values.own_ = std::make_shared<Array<std::byte>>(bytes.begin(), bytes.end());
    values.data_ = values.own_->data();
    values.components_ = components;
    values.type_ = type;
    values.stride_ = components * scalar_size(type);
    values.count_ = array.size() / components;
    return values;
  };
  Draco result;
  for (std::size_t i = 0; i < present.size(); ++i) {
    const DracoWork::Attribute& from = work.attribute[i];
    result.attribute.emplace(present[i], own(from.values, from.components, ScalarType::kFloat32));
  }
  result.indices = own(work.indices, 1, ScalarType::kUint32);
  return result;
}

}  // namespace surfel
