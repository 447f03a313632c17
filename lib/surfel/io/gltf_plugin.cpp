// Plug-in libsurfel_gltf.so: the one place that sees meshoptimizer and Draco, which few files need.

#include <cstring>
#include <exception>
#include <memory>

#include <draco/compression/decode.h>
#include <draco/compression/point_cloud/point_cloud_decoder.h>
#include <draco/core/varint_decoding.h>
#include <draco/metadata/metadata_decoder.h>
#include <meshoptimizer.h>
#include <surfel/base/export.h>
#include <surfel/io/gltf_plugin.h>

namespace surfel {
namespace {

/// Vertices and triangles that a byte may stand for: Draco takes memory for as many as its header
/// counts before it looks at the rest.
constexpr std::uint64_t kMostElementRatio = 1024;

/// Reads a number as Draco of this version writes it.
bool read_number(std::uint16_t version, draco::DecoderBuffer& from, std::uint64_t& number) {
  constexpr std::uint16_t kVarints = 0x0202;
  std::uint32_t value = 0;
  if (!(version < kVarints ? from.Decode(&value) : draco::DecodeVarint(&value, &from))) {
    return false;
  }
  number = value;
  return true;
}

/// Does the header count no more than the bytes can stand for?
bool counts_are_likely(std::span<const std::byte> coded) {
  draco::DecoderBuffer from;
  from.Init(reinterpret_cast<const char*>(coded.data()), coded.size());
  draco::DracoHeader header;
  if (!draco::PointCloudDecoder::DecodeHeader(&from, &header).ok() ||
      header.encoder_type != draco::TRIANGULAR_MESH) {
    return false;
  }
  if ((header.flags & METADATA_FLAG_MASK) != 0) {
    draco::GeometryMetadata metadata;
    if (!draco::MetadataDecoder().DecodeGeometryMetadata(&from, &metadata)) return false;
  }
  const auto version = static_cast<std::uint16_t>(header.version_major << 8 | header.version_minor);
  std::uint64_t first = 0;
  std::uint64_t second = 0;
  if (header.encoder_method == draco::MESH_EDGEBREAKER_ENCODING) {
    std::uint8_t traversal = 0;
    std::uint64_t split = 0;
    if (!from.Decode(&traversal)) return false;
    if (version < 0x0202 && !read_number(version, from, split)) return false;
  }
  if (!read_number(version, from, first) || !read_number(version, from, second)) return false;
  const std::uint64_t most = kMostElementRatio * coded.size();
  return first <= most && second <= most;
}

template <std::size_t kSize>
bool read_values(const draco::PointAttribute& from, std::size_t vertices, Array<float>& to) {
  to.resize(vertices * kSize);
  for (std::size_t i = 0; i < vertices; ++i) {
    const auto point = draco::PointIndex(static_cast<std::uint32_t>(i));
    if (!from.ConvertValue<float, kSize>(from.mapped_index(point), to.data() + i * kSize)) {
      return false;
    }
  }
  return true;
}

bool read_attribute(const draco::Mesh& mesh, DracoWork::Attribute& to) {
  const draco::PointAttribute* from = mesh.GetAttributeByUniqueId(to.id);
  if (!from) return false;
  to.components = static_cast<std::size_t>(from->num_components());
  const std::size_t vertices = mesh.num_points();
  switch (to.components) {
    case 1:
      return read_values<1>(*from, vertices, to.values);
    case 2:
      return read_values<2>(*from, vertices, to.values);
    case 3:
      return read_values<3>(*from, vertices, to.values);
    case 4:
      return read_values<4>(*from, vertices, to.values);
    default:
      return false;
  }
}

bool decode_draco(DracoWork& work) {
  if (!counts_are_likely(work.coded)) return false;
  draco::DecoderBuffer from;
  from.Init(reinterpret_cast<const char*>(work.coded.data()), work.coded.size());
  draco::Decoder decoder;
  auto decoded = decoder.DecodeMeshFromBuffer(&from);
  if (!decoded.ok()) return false;
  const std::unique_ptr<draco::Mesh> mesh = std::move(decoded).value();
  work.vertices = mesh->num_points();
  for (DracoWork::Attribute& attribute : work.attribute) {
    if (!read_attribute(*mesh, attribute)) return false;
  }
  work.indices.reserve(3 * static_cast<std::size_t>(mesh->num_faces()));
  for (std::uint32_t f = 0; f < mesh->num_faces(); ++f) {
    for (const draco::PointIndex& point : mesh->face(draco::FaceIndex(f))) {
      if (point.value() >= work.vertices) return false;
      work.indices.push_back(point.value());
    }
  }
  return true;
}

bool decode_meshopt(MeshoptWork& work) {
  const auto* const coded = reinterpret_cast<const unsigned char*>(work.coded.data());
  const std::size_t size = work.coded.size();
  int failed = 0;
  switch (work.mode) {
    case MeshoptWork::Mode::kAttributes:
      failed = meshopt_decodeVertexBuffer(work.out, work.count, work.stride, coded, size);
      break;
    case MeshoptWork::Mode::kTriangles:
      failed = meshopt_decodeIndexBuffer(work.out, work.count, work.stride, coded, size);
      break;
    case MeshoptWork::Mode::kIndices:
      failed = meshopt_decodeIndexSequence(work.out, work.count, work.stride, coded, size);
      break;
  }
  if (failed != 0) return false;
  switch (work.filter) {
    case MeshoptWork::Filter::kNone:
      break;
    case MeshoptWork::Filter::kOctahedral:
      meshopt_decodeFilterOct(work.out, work.count, work.stride);
      break;
    case MeshoptWork::Filter::kQuaternion:
      meshopt_decodeFilterQuat(work.out, work.count, work.stride);
      break;
    case MeshoptWork::Filter::kExponential:
      meshopt_decodeFilterExp(work.out, work.count, work.stride);
      break;
  }
  return true;
}

}  // namespace
}  // namespace surfel

extern "C" SURFEL_API bool surfel_gltf_plugin_meshopt(surfel::MeshoptWork& work);
extern "C" SURFEL_API bool surfel_gltf_plugin_draco(surfel::DracoWork& work);

extern "C" bool surfel_gltf_plugin_meshopt(surfel::MeshoptWork& work) {
  return surfel::decode_meshopt(work);
}

extern "C" bool surfel_gltf_plugin_draco(surfel::DracoWork& work) {
  try {
    return surfel::decode_draco(work);
  } catch (const std::exception&) {
    return false;
  }
}
