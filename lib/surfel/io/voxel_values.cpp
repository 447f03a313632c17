#include <algorithm>
#include <cmath>
#include <cstring>
#include <limits>
#include <span>

#include <fmt/format.h>
#include <surfel/base/error.h>
#include <surfel/base/memory.h>
#include <surfel/base/parallel.h>
#include <surfel/io/decompression.h>
#include <surfel/io/promises.h>
#include <surfel/io/voxel_values.h>

namespace surfel {
namespace {

constexpr std::size_t kVoxelGrain = std::size_t{1} << 16;
/// Bytes that gzip's header takes at most, with a name and a comment.
constexpr std::size_t kMostGzipHeader = std::size_t{1} << 20;

/// Turns bytes into floats.
void decode(const std::byte* bytes, ScalarType type, bool big_endian, std::size_t count,
            float* to) {
  visit_type(type, [&]<class T>(T value) {
    for (std::size_t i = 0; i < count; ++i) {
      std::byte one[sizeof(T)];
      std::memcpy(one, bytes + i * sizeof(T), sizeof(T));
      if (big_endian) std::reverse(one, one + sizeof(T));
      std::memcpy(&value, one, sizeof(T));
      to[i] = static_cast<float>(value);
    }
  });
}

}  // namespace

void require_volume(const Volume& volume, const std::string& file) {
  constexpr std::size_t kMostVoxels = std::size_t{1} << 40;
  std::size_t voxels = 1;
  for (const std::size_t size : volume.size) {
    if (size == 0 || size > kMostVoxels / voxels) {
      throw_input(file, fmt::format("a volume of {} x {} x {} voxels is not supported",
                                    volume.size[0], volume.size[1], volume.size[2]));
    }
    voxels *= size;
  }
  const std::uint64_t bytes = std::uint64_t{sizeof(float)} * voxels;
  if (bytes > available_memory_for(bytes)) {
    throw_input(file, fmt::format("{} voxels need {} MB of memory, more than there is; reduce its "
                                  "resolution",
                                  voxels, bytes >> 20));
  }
}

void read_voxels(const InputFile& input, const VoxelLayout& layout, Volume& volume) {
  require_volume(volume, input.name());
  const std::size_t bytes = volume.voxels() * scalar_size(layout.type);
  const auto fail = [&](const std::string& message) { throw_input(input.name(), message); };
  const std::size_t before = layout.compressed ? 0 : layout.offset;
  const std::size_t left = input.size() - std::min(input.size(), before);
  require_room(volume.voxels(), scalar_size(layout.type),
               layout.compressed ? left * kMostGzipRatio : left, kTheHeader, "voxels", fail);
  Array<std::byte> unpacked;
  if (layout.compressed) {
    // No program's compression makes data longer than this; what follows is not read.
    const std::size_t most = 2 * bytes + kMostGzipHeader;
    const std::size_t start = std::min(layout.offset, input.size());
    const std::size_t count = std::min(input.size() - start, most);
    Array<std::byte> packed;
    unpacked = gunzip({input.read_at(start, count, packed), count}, bytes, input.name());
  }
  volume.value.resize(volume.voxels());
  parallel_for(volume.voxels(), kVoxelGrain, [&](std::size_t begin, std::size_t end, int) {
    static thread_local Array<std::byte> scratch;
    const std::size_t size = scalar_size(layout.type);
    const std::byte* from = layout.compressed ? unpacked.data() + begin * size
                                              : input.read_at(layout.offset + begin * size,
                                                              (end - begin) * size, scratch);
    decode(from, layout.type, layout.big_endian, end - begin, volume.value.data() + begin);
  });
}

void finish_volume(Volume& volume, const std::string& file) {
  float least = std::numeric_limits<float>::infinity();
  for (const float value : volume.value) {
    if (std::isfinite(value)) least = std::min(least, value);
  }
  if (!std::isfinite(least)) throw_input(file, "no voxel has a finite value");
  for (float& value : volume.value) {
    if (std::isfinite(value)) continue;
    value = least;
    ++volume.not_finite;
  }
  // Squares and products of edges stay within the range of floats.
  constexpr double kLeastEdge = 1e-15;
  constexpr double kMostEdge = 1e15;
  constexpr double kRightAngle = 1e-3;  // Cosine that rounded numbers in headers have at most.
  for (std::size_t k = 0; k < 3; ++k) {
    const Vec3d& a = volume.step[k];
    const Vec3d& b = volume.step[(k + 1) % 3];
    if (!(a.norm() >= kLeastEdge && a.norm() <= kMostEdge) || !volume.origin.allFinite()) {
      throw_input(file, "the distances of voxels must be finite and not zero: 1e-15 to 1e15");
    }
    if (!(std::abs(a.dot(b)) <= kRightAngle * a.norm() * b.norm())) {
      throw_input(file, "the axes are not at right angles; resample the volume");
    }
  }
}

}  // namespace surfel
