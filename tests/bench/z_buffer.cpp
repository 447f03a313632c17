#include "bench/z_buffer.h"

#include <algorithm>
#include <bit>

#include <omp.h>

namespace surfel::bench {
namespace {

void draw(const ZCamera& c, const ZPoint* begin, const ZPoint* end, std::uint64_t* pixels) {
  const auto row = [](const float* r, const ZPoint& p) {
    return r[0] * p.x + r[1] * p.y + r[2] * p.z + r[3];
  };
  for (const ZPoint* p = begin; p != end; ++p) {
    const float depth = row(c.row_z, *p);
    const float inverse = 1 / depth;
    const auto x = static_cast<int>(row(c.row_x, *p) * inverse + c.center_x);
    const auto y = static_cast<int>(row(c.row_y, *p) * inverse + c.center_y);
    // As unsigned numbers negative ones are too large; what is behind the eye is one comparison.
    if (!(depth > 0) || static_cast<unsigned>(x) >= static_cast<unsigned>(c.width) ||
        static_cast<unsigned>(y) >= static_cast<unsigned>(c.height)) {
      continue;
    }
    // Positive floats are ordered as their bits are.
    const std::uint64_t key = std::uint64_t{std::bit_cast<std::uint32_t>(inverse)} << 32 | p->color;
    std::uint64_t& pixel = pixels[static_cast<std::size_t>(y) * c.width + x];
    if (key > pixel) pixel = key;
  }
}

}  // namespace

ZBufferLoop::ZBufferLoop(const ZCamera& camera, int threads)
    : camera_(camera),
      buffers_(threads,
               std::vector<std::uint64_t>(static_cast<std::size_t>(camera.width) * camera.height)) {
}

void ZBufferLoop::run(const ZPoint* points, std::size_t count) {
  const int threads = static_cast<int>(buffers_.size());
  const std::size_t size = buffers_.front().size();
#pragma omp parallel num_threads(threads)
  {
    const auto t = static_cast<std::size_t>(omp_get_thread_num());
    std::fill(buffers_[t].begin(), buffers_[t].end(), 0);
    draw(camera_, points + count * t / threads, points + count * (t + 1) / threads,
         buffers_[t].data());
#pragma omp barrier
    std::uint64_t* first = buffers_.front().data();
    for (int other = 1; other < threads; ++other) {
      const std::uint64_t* from = buffers_[other].data();
      for (std::size_t i = size * t / threads; i < size * (t + 1) / threads; ++i) {
        first[i] = std::max(first[i], from[i]);
      }
    }
  }
}

}  // namespace surfel::bench
