#include <algorithm>
#include <array>
#include <cstdint>
#include <vector>

#include <surfel/base/parallel.h>
#include <surfel/store/record_source.h>
#include <surfel/store/render_cloud.h>

namespace surfel {

using enum SurfelAttribute;

RecordSource::RecordSource(const RecordTable& table, const std::string& file,
                           const std::optional<Bounds>& bounds)
    : table_(table), decoder_(table, file) {
  if (!decoder_.anisotropic() && !decoder_.has(kVariance)) throw_no_variance(file);
  if (bounds || decoder_.double_positions()) {
    decoder_.set_origin(float_origin(bounds ? *bounds : measure()));
  }
}

SurfelAttributes RecordSource::attributes() const {
  return {.anisotropic = decoder_.anisotropic(),
          .normal = decoder_.has(kNormal),
          .shading_normal = decoder_.has(kShadingNormal),
          .area = decoder_.has(kArea),
          .clip1 = decoder_.has(kClip1),
          .clip2 = decoder_.has(kClip2),
          .color = decoder_.has(kCoefficient) || decoder_.has(kColor),
          .alpha = decoder_.has(kAlpha),
          .material = decoder_.has(kMaterial),
          .group = decoder_.has(kGroup),
          .group_radius = decoder_.has(kGroupRadius),
          .source = decoder_.has(kSource)};
}

bool RecordSource::recenter(const Bounds& bounds) {
  if (decoder_.double_positions()) return false;  // Placed before.
  const Vec3d origin = float_origin(bounds);
  if (origin == decoder_.origin()) return false;
  decoder_.set_origin(origin);
  return true;
}

const std::byte* RecordSource::read(std::size_t begin, std::size_t end) const {
  // Kept from block to block.
  static thread_local Array<std::byte> scratch;
  return table_.read(begin, end, scratch);
}

void RecordSource::expect(std::size_t begin, std::size_t end) const {
  if (!table_.file) return;
  table_.file->expect(table_.offset + begin * table_.stride, (end - begin) * table_.stride);
}

Bounds RecordSource::measure() const {
  PerWorker<CoordinateSpread> parts;
  parallel_for(table_.count, RenderCloud::kBlock,
               [&](std::size_t begin, std::size_t end, int worker) {
                 const std::byte* records = read(begin, end);
                 for (std::size_t i = begin; i < end; i += SurfelDecoder::kPiece) {
                   const std::size_t count = std::min(SurfelDecoder::kPiece, end - i);
                   decoder_.measure(records, count, parts[worker]);
                   records += count * table_.stride;
                 }
               });
  CoordinateSpread spread;
  parts.for_each([&](const CoordinateSpread& part) { spread.add(part); });
  return spread.core(spread.box());
}

void RecordSource::fill(std::size_t begin, std::size_t end, RenderCloud& cloud,
                        std::size_t row) const {
  const SurfelAttributes known = attributes();
  for (; begin < end; begin += RenderCloud::kBlock) {
    const std::size_t block_end = std::min(begin + RenderCloud::kBlock, end);
    const std::byte* records = read(begin, block_end);
    for (std::size_t i = begin; i < block_end; i += SurfelDecoder::kPiece) {
      const std::size_t count = std::min(SurfelDecoder::kPiece, block_end - i);
      decode(records, count, cloud, row);
      make_drawable(known, cloud, row, count);
      records += count * table_.stride;
      row += count;
    }
  }
}

void RecordSource::decode(const std::byte* records, std::size_t count, RenderCloud& to,
                          std::size_t row) const {
  const auto vector = [&](SurfelAttribute attribute, Array<float>& x, Array<float>& y,
                          Array<float>& z) {
    if (!decoder_.has(attribute)) return;
    decoder_.decode<float>(attribute, records, count,
                           {{x.data() + row, y.data() + row, z.data() + row}});
  };
  const auto scalar = [&]<class T>(SurfelAttribute attribute, Array<T>& column) {
    if (column.empty() || !decoder_.has(attribute)) return;
    decoder_.decode<T>(attribute, records, count, {{column.data() + row}});
  };
  vector(kPosition, to.x, to.y, to.z);
  vector(kNormal, to.normal_x, to.normal_y, to.normal_z);
  vector(kShadingNormal, to.shading_x, to.shading_y, to.shading_z);
  vector(kTangent, to.tangent_x, to.tangent_y, to.tangent_z);
  scalar(decoder_.anisotropic() ? kVarianceU : kVariance, to.deviation_u);
  scalar(kVarianceV, to.deviation_v);
  scalar(kArea, to.area);
  vector(kClip1, to.clip[0].x, to.clip[0].y, to.clip[0].z);
  scalar(kClip1Distance, to.clip[0].distance);
  vector(kClip2, to.clip[1].x, to.clip[1].y, to.clip[1].z);
  scalar(kClip2Distance, to.clip[1].distance);
  vector(decoder_.has(kCoefficient) ? kCoefficient : kColor, to.red, to.green, to.blue);
  scalar(kAlpha, to.alpha);
  scalar(kMaterial, to.material);
  scalar(kGroup, to.group);
  scalar(kGroupRadius, to.group_radius);
}

void RecordSource::fill_sources(std::size_t begin, std::size_t end, std::uint32_t* to) const {
  for (; begin < end; begin += RenderCloud::kBlock) {
    const std::size_t count = std::min(RenderCloud::kBlock, end - begin);
    decoder_.decode<std::uint32_t>(kSource, read(begin, begin + count), count, {{to}});
    to += count;
  }
}

std::vector<std::string> RecordSource::columns() const {
  std::vector<std::string> names;
  if (decoder_.has(kMaterial)) names.emplace_back(kMaterialColumn);
  if (decoder_.has(kGroup)) names.emplace_back(kGroupColumn);
  if (decoder_.has(kLevel)) names.emplace_back(kLevelColumn);
  for (const RecordColumn* other : decoder_.others()) names.push_back(other->name);
  return names;
}

void RecordSource::fill_column(std::size_t column, std::size_t begin, std::size_t end,
                               double* to) const {
  std::array<std::byte, SurfelDecoder::kPiece * sizeof(double)> piece;
  for (; begin < end; begin += SurfelDecoder::kPiece, to += SurfelDecoder::kPiece) {
    const std::size_t count = std::min(SurfelDecoder::kPiece, end - begin);
    const std::byte* records = read(begin, begin + count);
    std::size_t place = 0;
    const auto whole = [&]<class T>(SurfelAttribute attribute, T) {
      if (!decoder_.has(attribute) || place++ != column) return;
      std::array<T, SurfelDecoder::kPiece> values;
      decoder_.decode<T>(attribute, records, count, {{values.data()}});
      std::copy_n(values.begin(), count, to);
    };
    whole(kMaterial, std::uint16_t{});
    whole(kGroup, std::uint16_t{});
    whole(kLevel, std::uint8_t{});
    if (column < place) continue;
    const RecordColumn& other = *decoder_.others()[column - place];
    decoder_.decode(other, records, count, piece.data());
    load_scalars(other.type, piece.data(), count, to);
  }
}

}  // namespace surfel
