#include <algorithm>
#include <bit>

#include <surfel/base/parallel.h>
#include <surfel/base/random.h>
#include <surfel/estimate/place_sample.h>

namespace surfel {
namespace {

constexpr std::size_t kHashGrain = 1 << 16;

std::uint64_t hash_of(const Vec3f& p) {
  const auto bits = [](float x) {
    // The two zeros are one place.
    return std::uint64_t{std::bit_cast<std::uint32_t>(x + 0.0F)};
  };
  return random_bits(bits(p.z()), bits(p.x()) << 32 | bits(p.y()));
}

}  // namespace

/// Sorts by hash, leaves out repeated places, and keeps the first `most`.
void PlaceSample::keep_least(std::size_t most, std::vector<Hashed>& some) {
  const auto before = [](const Hashed& a, const Hashed& b) {
    if (a.hash != b.hash) return a.hash < b.hash;
    return std::lexicographical_compare(a.place.begin(), a.place.end(), b.place.begin(),
                                        b.place.end());
  };
  std::sort(some.begin(), some.end(), before);
  some.erase(std::unique(some.begin(), some.end(),
                         [](const Hashed& a, const Hashed& b) { return a.place == b.place; }),
             some.end());
  if (some.size() > most) some.resize(most);
}

void PlaceSample::add(std::span<const Vec3f> points) {
  if (most_ == 0) return;
  const auto bound_of = [&](const std::vector<Hashed>& least) {
    return least.size() < most_ ? ~std::uint64_t{0} : least.back().hash;
  };
  std::vector<std::vector<Hashed>> found((points.size() + kHashGrain - 1) / kHashGrain);
  parallel_for(points.size(), kHashGrain, [&](std::size_t begin, std::size_t end, int) {
    std::vector<Hashed>& some = found[begin / kHashGrain];
    std::uint64_t bound = bound_of(least_);
    for (std::size_t i = begin; i < end; ++i) {
      const std::uint64_t hash = hash_of(points[i]);
      if (hash > bound) continue;
      some.push_back({hash, points[i]});
      if (some.size() < 4 * most_) continue;
      keep_least(most_, some);
      bound = std::min(bound, bound_of(some));
    }
    keep_least(most_, some);
  });
  for (const std::vector<Hashed>& some : found) {
    least_.insert(least_.end(), some.begin(), some.end());
  }
  keep_least(most_, least_);
}

std::vector<Vec3f> PlaceSample::places() const {
  std::vector<Vec3f> out;
  out.reserve(least_.size());
  for (const Hashed& h : least_) out.push_back(h.place);
  return out;
}

}  // namespace surfel
