#include <algorithm>
#include <bit>
#include <cmath>
#include <limits>
#include <optional>
#include <span>
#include <tuple>
#include <utility>

#include <fmt/format.h>
#include <surfel/base/error.h>
#include <surfel/base/parallel.h>
#include <surfel/measure/disc_coverage.h>
#include <surfel/measure/streamed_statistics.h>
#include <surfel/scene/surfel_variance.h>

namespace surfel {
namespace {

constexpr std::size_t kSampleGrain = 64;
/// Bytes that a sample takes: its neighbours, its cell, itself.
constexpr std::uint64_t kSampleBytes = 1600;

/// A surfel that was found near a sample.
struct NearDisc {
  float distance2;
  std::uint64_t index;  ///< Among the discs of the cloud.
  std::uint64_t first;  ///< Least index of those at the same place.
  Vec3f position;
  std::uint16_t told;  ///< What is noted of it.

  /// As NeighborSearch lists them: by distance, by place, by index.
  auto rank() const { return std::tuple(distance2, first, index); }
};

/// A surfel around which is measured.
struct Sample {
  std::uint64_t surfel = 0;  ///< Its number in the cloud.
  std::uint64_t disc = 0;    ///< Its number among the discs.
  Vec3f position{0, 0, 0};
  Vec3f normal{0, 0, 0};
  std::optional<float> radius;  ///< Unset without variances.
};

/// A sample's cell, and the discs that may lie over it.
struct OpenCell {
  std::optional<SurfelCell> cell;
  std::size_t found = 0;  ///< More than kMostDiscs: no longer counted.
  std::uint16_t covered = 0;
  std::uint64_t overlap = 0;
};

/// Adds what was found in a piece to a list of the `most` nearest.
/// \param before  discs of the pieces before
template <class Tell>
void take_nearest(std::vector<NearDisc>& list, std::span<const Neighbor> found,
                  std::uint64_t before, const MeasuredDiscs& discs, std::size_t most,
                  const Tell& tell) {
  const std::size_t old = list.size();
  for (const Neighbor& next : found) {
    const std::uint64_t index = before + next.index;
    NearDisc disc{next.distance2, index, index, discs.position[next.index], tell(next.index)};
    const auto here = [&](const NearDisc& other) {
      return other.distance2 == disc.distance2 && other.position == disc.position;
    };
    const auto end = list.begin() + static_cast<std::ptrdiff_t>(old);
    const auto known = std::find_if(list.begin(), end, here);
    if (known != end) {
      disc.first = known->first;
    } else if (list.size() > old && here(list.back())) {
      disc.first = list.back().first;
    }
    list.push_back(disc);
  }
  std::sort(list.begin(), list.end(),
            [](const NearDisc& a, const NearDisc& b) { return a.rank() < b.rank(); });
  // There are many lists: none keeps more memory than it needs.
  list = {list.begin(), list.begin() + static_cast<std::ptrdiff_t>(std::min(list.size(), most))};
}

/// Squared distance to the box around some positions, no further than to any of them.
class PieceBox {
 public:
  explicit PieceBox(const Array<Vec3f>& positions) {
    for (const Vec3f& p : positions) {
      low_ = low_.cwiseMin(p);
      high_ = high_.cwiseMax(p);
    }
  }
  float distance2(const Vec3f& p) const {
    return (low_ - p).cwiseMax(p - high_).cwiseMax(0.0F).squaredNorm();
  }

 private:
  Vec3f low_ = Vec3f::Constant(std::numeric_limits<float>::infinity());
  Vec3f high_ = Vec3f::Constant(-std::numeric_limits<float>::infinity());
};

/// The disc radius at a cutoff of a variance that is usable, or 0.
float radius_at(float variance, double cutoff) {
  return variance > 0 ? static_cast<float>(std::sqrt(2 * cutoff * static_cast<double>(variance)))
                      : 0.0F;
}

/// Measures around samples, pass by pass.
class SampledCells {
 public:
  SampledCells(const CloudPasses& pieces, const CloudStatisticsOptions& options,
               std::uint64_t finite)
      : pieces_(pieces), options_(options), finite_(finite) {}

  void find_samples();
  /// Finds the neighbours of the samples, and with them their cells.
  /// \param normals  Are there normals and variances, so that coverage will be measured?
  void find_neighbors(bool normals);
  void measure_spacing(CloudStatistics& out);
  std::optional<Coverage> coverage(float largest_radius, float median_radius, std::uint64_t memory);

 private:
  /// Calls body(piece, discs, surfels before, discs before).
  template <class Body>
  void for_discs(const Body& body) const {
    std::uint64_t surfels = 0;
    std::uint64_t discs = 0;
    pieces_([&](const SurfelCloud& piece) {
      const MeasuredDiscs found = finite_discs(piece, options_.cutoff);
      if (!found.position.empty()) body(piece, found, surfels, discs);
      surfels += piece.size();
      discs += found.position.size();
    });
  }
  float reach(const OpenCell& open, float largest_radius) const {
    return static_cast<float>(largest_radius + open.cell->radius) * kReachRounding;
  }
  /// Which points of a sample's cell a disc of a piece covers.
  std::uint16_t covered(std::size_t q, const SurfelCloud& piece, const MeasuredDiscs& discs,
                        std::uint32_t j) const;
  void count_discs(float largest_radius, bool unlike);
  std::vector<std::size_t> chosen_cells(std::vector<CellCoverage>& cells) const;
  void measure_nearest(std::span<const std::size_t> crowded, float largest_radius,
                       std::vector<CellCoverage>& cells) const;

  const CloudPasses& pieces_;
  const CloudStatisticsOptions& options_;
  std::uint64_t finite_;
  std::vector<Sample> samples_;
  std::vector<double> spacing_;
  std::vector<std::size_t> within_;  ///< Other surfels within the samples' radii.
  std::vector<OpenCell> cells_;
};

void SampledCells::find_samples() {
  const std::vector<std::size_t> picked = sampled(finite_, options_.samples, options_.seed);
  samples_.reserve(picked.size());
  for_discs([&](const SurfelCloud& piece, const MeasuredDiscs& discs, std::uint64_t surfels,
                std::uint64_t before) {
    while (samples_.size() < picked.size() &&
           picked[samples_.size()] < before + discs.position.size()) {
      const std::uint64_t disc = picked[samples_.size()];
      const std::uint32_t i = discs.surfel[disc - before];
      samples_.push_back({surfels + i,
                          disc,
                          piece.position[i],
                          piece.normal.empty() ? Vec3f(0, 0, 0) : piece.normal[i],
                          {}});
      if (!discs.radius.empty()) samples_.back().radius = discs.radius[disc - before];
    }
  });
}

void SampledCells::find_neighbors(bool normals) {
  constexpr std::size_t kMost = kCellNeighbors + 1;
  std::vector<std::vector<NearDisc>> near(samples_.size());
  for_discs([&](const SurfelCloud& piece, const MeasuredDiscs& discs, std::uint64_t,
                std::uint64_t before) {
    const auto search = make_neighbor_search(discs.position);
    const PieceBox box(discs.position);
    parallel_for(samples_.size(), kSampleGrain, [&](std::size_t begin, std::size_t end, int) {
      std::vector<Neighbor> found;
      for (std::size_t q = begin; q < end; ++q) {
        const Sample& sample = samples_[q];
        const float limit2 = near[q].size() < kMost ? std::numeric_limits<float>::infinity()
                                                    : near[q].back().distance2;
        if (box.distance2(sample.position) > limit2) continue;
        search->search(sample.position, kMost, limit2, found);
        take_nearest(near[q], found, before, discs, kMost, [&](std::uint32_t j) {
          const bool same = normals && same_surface(piece.normal[discs.surfel[j]], sample.normal);
          return static_cast<std::uint16_t>(same ? 1 : 0);
        });
      }
    });
  });
  spacing_.resize(samples_.size());
  within_.resize(samples_.size());
  cells_.resize(samples_.size());
  parallel_each(samples_.size(), kSampleGrain, [&](std::size_t q) {
    const Sample& sample = samples_[q];
    double nearest = std::numeric_limits<double>::infinity();
    for (std::size_t n = 0; n < near[q].size(); ++n) {
      if (near[q][n].index == sample.disc) continue;
      const double to = (near[q][n].position - sample.position).cast<double>().norm();
      if (n < 2) nearest = std::min(nearest, to);
      if (sample.radius && to <= *sample.radius) ++within_[q];
    }
    spacing_[q] = nearest;
    if (!normals) return;
    std::vector<CellNeighbor> around;
    for (const NearDisc& disc : near[q]) around.push_back({disc.position, disc.told != 0});
    cells_[q].cell =
        surfel_cell(sample.position, sample.normal, sample.surfel, options_.seed, around);
    near[q] = {};
  });
}

void SampledCells::measure_spacing(CloudStatistics& out) {
  if (finite_ < 2) return;
  if (samples_.front().radius) {
    out.neighbors.emplace();
    for (const std::size_t count : within_) out.neighbors->add(count);
  }
  const auto coincident = std::count(spacing_.begin(), spacing_.end(), 0.0);
  out.coincident_share = static_cast<double>(coincident) / static_cast<double>(spacing_.size());
  out.spacing = distribution(std::move(spacing_));
}

std::uint16_t SampledCells::covered(std::size_t q, const SurfelCloud& piece,
                                    const MeasuredDiscs& discs, std::uint32_t j) const {
  std::uint16_t out = 0;
  for (int point = 0; point < kPointsPerCell; ++point) {
    const bool over = covers(piece, discs.surfel[j], discs.radius[j], options_.cutoff,
                             samples_[q].normal, cells_[q].cell->points[point]);
    out = static_cast<std::uint16_t>(out | (over ? 1 << point : 0));
  }
  return out;
}

/// Counts the discs that may lie over the cells and, where they are not too many, what they cover.
/// \param unlike  The radii differ much.
void SampledCells::count_discs(float largest_radius, bool unlike) {
  for_discs(
      [&](const SurfelCloud& piece, const MeasuredDiscs& discs, std::uint64_t, std::uint64_t) {
        const auto search = unlike ? nullptr : make_neighbor_search(discs.position);
        std::optional<DiscsAround> around;
        if (unlike) around.emplace(discs, largest_radius);
        parallel_for(cells_.size(), kSampleGrain, [&](std::size_t begin, std::size_t end, int) {
          std::vector<Neighbor> near;
          for (std::size_t q = begin; q < end; ++q) {
            OpenCell& open = cells_[q];
            if (!open.cell || open.found > kMostDiscs) continue;
            const Vec3f& center = samples_[q].position;
            if (around) {
              around->within(center, open.cell->radius, near);
            } else {
              search->within(center, reach(open, largest_radius), kMostDiscs + 1, near);
            }
            open.found += near.size();
            if (open.found > kMostDiscs) continue;
            for (const Neighbor& neighbor : near) {
              const std::uint16_t over = covered(q, piece, discs, neighbor.index);
              open.covered = static_cast<std::uint16_t>(open.covered | over);
              open.overlap += static_cast<std::uint64_t>(std::popcount(over));
            }
          }
        });
      });
}

/// Fills in the cells of the rounds that are measured; returns the cells among them that have too
/// many discs over them for all to be counted.
std::vector<std::size_t> SampledCells::chosen_cells(std::vector<CellCoverage>& cells) const {
  std::vector<std::size_t> crowded;
  std::size_t looked_at = 0;
  for (std::size_t round = 0; round < std::min(kCellRounds, cells.size()); ++round) {
    for (std::size_t q = round; q < cells.size(); q += kCellRounds) {
      const OpenCell& open = cells_[q];
      if (!open.cell) continue;
      CellCoverage& cell = cells[q];
      cell.area = open.cell->area;
      cell.points = kPointsPerCell;
      cell.looked_at = std::min(open.found, kMostDiscs);
      cell.holes = kPointsPerCell - std::popcount(open.covered);
      cell.overlap = static_cast<double>(open.overlap);
      looked_at += cell.looked_at;
      if (open.found > kMostDiscs) crowded.push_back(q);
    }
    if (looked_at > kDiscsPerCell * cells.size()) break;
  }
  return crowded;
}

/// Measures cells by the kMostDiscs nearest of their discs.
void SampledCells::measure_nearest(std::span<const std::size_t> crowded, float largest_radius,
                                   std::vector<CellCoverage>& cells) const {
  std::vector<std::vector<NearDisc>> nearest(crowded.size());
  for_discs([&](const SurfelCloud& piece, const MeasuredDiscs& discs, std::uint64_t,
                std::uint64_t before) {
    const auto search = make_neighbor_search(discs.position);
    parallel_each(crowded.size(), 1, [&](std::size_t k) {
      const std::size_t q = crowded[k];
      std::vector<Neighbor> near;
      search->within(samples_[q].position, reach(cells_[q], largest_radius), kMostDiscs, near);
      take_nearest(nearest[k], near, before, discs, kMostDiscs,
                   [&](std::uint32_t j) { return covered(q, piece, discs, j); });
    });
  });
  for (std::size_t k = 0; k < crowded.size(); ++k) {
    std::uint16_t covered = 0;
    std::uint64_t overlap = 0;
    for (const NearDisc& disc : nearest[k]) {
      covered = static_cast<std::uint16_t>(covered | disc.told);
      overlap += static_cast<std::uint64_t>(std::popcount(disc.told));
    }
    CellCoverage& cell = cells[crowded[k]];
    cell.holes = kPointsPerCell - std::popcount(covered);
    cell.overlap = static_cast<double>(overlap);
  }
}

std::optional<Coverage> SampledCells::coverage(float largest_radius, float median_radius,
                                               std::uint64_t memory) {
  count_discs(largest_radius, largest_radius > kLikeRadii * median_radius);
  std::vector<CellCoverage> cells(cells_.size());
  const std::vector<std::size_t> crowded = chosen_cells(cells);
  const std::size_t at_once = std::max<std::size_t>(
      1, static_cast<std::size_t>(memory / (2 * kMostDiscs * sizeof(NearDisc))));
  for (std::size_t begin = 0; begin < crowded.size(); begin += at_once) {
    const std::size_t count = std::min(at_once, crowded.size() - begin);
    measure_nearest(std::span(crowded).subspan(begin, count), largest_radius, cells);
  }
  return coverage_of_cells(cells);
}

}  // namespace

StreamedStatistics::StreamedStatistics(CloudPasses pieces, std::uint64_t memory,
                                       const CloudStatisticsOptions& options)
    : pieces_(std::move(pieces)), memory_(memory), options_(options) {}

void StreamedStatistics::add(const SurfelCloud& piece) {
  count_flaws(piece, counted_);
  const Bounds box = piece.bounds();
  if (!box.empty()) {
    counted_.bounds.add(box.min);
    counted_.bounds.add(box.max);
  }
  normals_ = !piece.normal.empty();
  variances_ = has_variance(piece);
  for (std::size_t i = 0; i < piece.size(); ++i) {
    if (!finite(piece.position[i])) continue;
    ++finite_;
    if (!variances_) continue;
    const float radius = disc_radius(piece, i, options_.cutoff);
    const float variance = radius > 0 ? largest_variance(piece, i) : 0;
    variance_.count(variance);
    largest_variance_ = std::max(largest_variance_, variance);
    radius_sum_ += radius;
  }
}

void StreamedStatistics::choose() {
  if (chosen_ || variance_.size() == 0) return;
  chosen_ = true;
  const std::uint64_t n = variance_.size();
  variance_.choose({0, rank_of(0.05, n), rank_of(0.5, n), rank_of(0.95, n), n - 1, n / 2});
}

void StreamedStatistics::look(const SurfelCloud& piece) {
  choose();
  if (variance_.size() == 0) return;
  for (std::size_t i = 0; i < piece.size(); ++i) {
    if (!finite(piece.position[i])) continue;
    variance_.look(disc_radius(piece, i, options_.cutoff) > 0 ? largest_variance(piece, i) : 0);
  }
}

CloudStatistics StreamedStatistics::finish() {
  CloudStatistics out = counted_;
  if (variance_.size() > 0) {
    for (std::size_t i = 0; i < 6; ++i) ranked_.push_back(variance_.value(i));
    const auto radius = [&](std::size_t i) -> double {
      return radius_at(ranked_[i], options_.cutoff);
    };
    out.radius = {radius_sum_ / static_cast<double>(variance_.size()),
                  radius(0),
                  radius(1),
                  radius(2),
                  radius(3),
                  radius(4)};
  }
  if (finite_ > 0) measure(options_, out);
  return out;
}

void StreamedStatistics::measure(const CloudStatisticsOptions& options,
                                 CloudStatistics& out) const {
  const std::uint64_t samples = std::min<std::uint64_t>(options.samples, finite_);
  if (samples * kSampleBytes > memory_) {
    throw_usage(fmt::format(
        "{} samples take {} MB of memory, of which {} MB are left for them: lower `samples` to {}, "
        "or give more memory",
        samples, (samples * kSampleBytes >> 20) + 1, memory_ >> 20, memory_ / kSampleBytes));
  }
  const bool coverage = normals_ && variances_;
  SampledCells cells(pieces_, options, finite_);
  cells.find_samples();
  cells.find_neighbors(coverage);
  cells.measure_spacing(out);
  if (!coverage) return;
  out.coverage = cells.coverage(radius_at(ranked_[4], options.cutoff),
                                radius_at(ranked_[5], options.cutoff), memory_);
}

double StreamedStatistics::holes(const CloudStatisticsOptions& options) const {
  CloudStatistics out;
  measure(options, out);
  return out.coverage ? out.coverage->hole_share : 1;
}

}  // namespace surfel
