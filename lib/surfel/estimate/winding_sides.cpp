#include <Eigen/Geometry>
#include <algorithm>
#include <array>
#include <cmath>
#include <cstddef>
#include <numbers>
#include <queue>
#include <span>
#include <unordered_map>
#include <utility>

#include <surfel/base/group_by_key.h>
#include <surfel/base/morton.h>
#include <surfel/base/parallel.h>
#include <surfel/estimate/dipole_energies.h>
#include <surfel/estimate/spanning_forest.h>
#include <surfel/estimate/winding_sides.h>

namespace surfel {
namespace {

constexpr std::size_t kBlockGrain = 16;
/// Blocks are the cells two levels up. Dipoles of a block and of those around it meet.
constexpr int kBlockLevels = 2;
/// Dipoles of a block that meet others, the largest: a few sheets' at least.
constexpr std::size_t kMostOfBlock = 64;
/// Levels of no more blocks have no coarser ones.
constexpr std::size_t kLastBlocks = 8;
/// Sheets of less area, in cells of a level, have no say there: beyond their own surroundings what
/// they add is less than the noise of the larger sheets' sums, and pairs with them would be most of
/// all pairs. The finest level has all sheets.
constexpr double kLeastArea = 8;
/// Closed sheets' energies cancel only if all levels are in their sums.
constexpr double kLeastAreaOfClosed = 0.25;
/// The energies between two sheets cancel where their sum is less than this share of them: between
/// closed surfaces nothing else is in the sum but the terms that are left out of it.
constexpr double kLeastConsensus = 0.01;
constexpr double kLeastOfClosed = 0.05;
/// Sheets count as closed from this WindingSides::Part::closed on, in that they have no borders ...
constexpr double kClosed = 0.8;
/// ... and parts from this on, in that they have an inside: half a ball has 0.5.
constexpr double kLeastClosed = 0.4;
/// Most dipoles and parts that are looked at to tell which part is within which.
constexpr std::size_t kMostEnclosing = 4096;
/// Places of a part that must be inside of another, at most.
constexpr std::size_t kPlaces = 16;
constexpr int kDescentRounds = 50;

/// Energy between two sheets, a < b, if both stay as they are.
struct Coupling {
  std::uint32_t a, b;
  double sum;   ///< Above zero: one should be turned.
  double size;  ///< Sum of the absolute values of its terms.
};

void add_up(std::vector<Coupling>& couplings) {
  std::stable_sort(couplings.begin(), couplings.end(), [](const Coupling& x, const Coupling& y) {
    return x.a != y.a ? x.a < y.a : x.b < y.b;
  });
  std::size_t kept = 0;
  for (const Coupling& c : couplings) {
    if (kept > 0 && couplings[kept - 1].a == c.a && couplings[kept - 1].b == c.b) {
      couplings[kept - 1].sum += c.sum;
      couplings[kept - 1].size += c.size;
    } else {
      couplings[kept++] = c;
    }
  }
  couplings.resize(kept);
}

/// Dipoles that meet those around them.
struct CellBlock {
  std::uint64_t code;  ///< Of its cell.
  std::vector<std::uint32_t> dipole;
  std::uint32_t sheet;  ///< Of all dipoles, or kNone.
};

/// Dipoles in and around a block, sorted by sheet.
struct Surroundings {
  /// One number, by which entries are sorted: the sheet, the dipole, and whether it lies in the
  /// block itself.
  struct Entry {
    std::uint64_t key;

    Entry(std::uint32_t sheet, std::uint32_t dipole, bool own)
        : key(std::uint64_t{sheet} << 32 | std::uint64_t{dipole} << 1 | (own ? 1 : 0)) {}
    std::uint32_t sheet() const { return static_cast<std::uint32_t>(key >> 32); }
    std::uint32_t dipole() const { return static_cast<std::uint32_t>(key) >> 1; }
    bool own() const { return (key & 1) != 0; }
    bool operator<(const Entry& o) const { return key < o.key; }
  };
  std::vector<Entry> entry;
  DipoleColumns dipole;       ///< Lengths in cells of the level, from the block's corner.
  std::vector<Coupling> row;  ///< Of one of the block's sheets with all after it.
};

class WindingSolver {
 public:
  explicit WindingSolver(const WindingDipoles& points)
      : count_(points.sheets()),
        cell_(points.grid().cell),
        finest_(points.sorted()),
        sets_(count_) {}

  WindingSides run() {
    std::vector<WindingDipole> dipoles = finest_;
    for (int level = 0; level + kBlockLevels < WindingGrid::kLevels; ++level) {
      if (coarse_.empty() || coarse_.size() > kMostEnclosing) {
        coarse_ = dipoles;
        coarse_level_ = level;
      }
      if (count_ < 2 || !couple(dipoles, level)) break;
      coarsen(dipoles);
    }
    join();
    descend();
    return parts();
  }

 private:
  /// Merges the dipoles of each sheet in each cell of the next level.
  static void coarsen(std::vector<WindingDipole>& dipoles) {
    std::vector<WindingDipole> out;
    std::vector<WindingDipole> cell;
    const auto flush = [&] {
      std::stable_sort(
          cell.begin(), cell.end(),
          [](const WindingDipole& a, const WindingDipole& b) { return a.sheet < b.sheet; });
      for (const WindingDipole& d : cell) {
        if (!out.empty() && out.back().cell == d.cell && out.back().sheet == d.sheet) {
          out.back().add(d, false);
        } else {
          out.push_back(d);
        }
      }
      cell.clear();
    };
    for (const WindingDipole& d : dipoles) {
      const std::uint64_t code = d.cell >> 3;
      if (!cell.empty() && cell.front().cell != code) flush();
      cell.push_back(d);
      cell.back().cell = code;
    }
    flush();
    dipoles = std::move(out);
  }

  /// The blocks of a level, ascending by code; of crowded ones the largest dipoles.
  std::vector<CellBlock> blocks_of(const std::vector<WindingDipole>& dipoles, int level) const {
    std::vector<double> sheet_area(count_);
    std::vector<Vec3d> moment(count_, Vec3d(0, 0, 0));
    for (const WindingDipole& d : dipoles) {
      sheet_area[d.sheet] += d.area;
      moment[d.sheet] += d.moment;
    }
    const auto seen = [&](std::uint32_t k) {
      const bool closed = moment[k].norm() <= (1 - kClosed) * sheet_area[k];
      return std::ldexp(sheet_area[k], -2 * level) >= (closed ? kLeastAreaOfClosed : kLeastArea);
    };
    std::vector<CellBlock> blocks;
    for (std::uint32_t i = 0; i < dipoles.size(); ++i) {
      const std::uint32_t sheet = dipoles[i].sheet;
      if (level > 0 && !seen(sheet)) continue;
      const std::uint64_t code = dipoles[i].cell >> (3 * kBlockLevels);
      if (blocks.empty() || blocks.back().code != code) blocks.push_back({code, {}, sheet});
      CellBlock& block = blocks.back();
      block.dipole.push_back(i);
      if (block.sheet != sheet) block.sheet = PointSheets::kNone;
    }
    for (CellBlock& block : blocks) {
      if (block.dipole.size() <= kMostOfBlock) continue;
      const auto larger = [&](std::uint32_t i, std::uint32_t j) {
        return dipoles[i].area != dipoles[j].area ? dipoles[i].area > dipoles[j].area : i < j;
      };
      std::nth_element(block.dipole.begin(), block.dipole.begin() + kMostOfBlock,
                       block.dipole.end(), larger);
      block.dipole.resize(kMostOfBlock);
    }
    return blocks;
  }

  /// Adds the energies between sheets on a level. Returns whether there are coarser levels.
  bool couple(const std::vector<WindingDipole>& dipoles, int level) {
    const std::vector<CellBlock> blocks = blocks_of(dipoles, level);
    const bool last = blocks.size() <= kLastBlocks;
    PerWorker<Surroundings> scratch;
    std::vector<std::vector<Coupling>> found((blocks.size() + kBlockGrain - 1) / kBlockGrain);
    parallel_for(blocks.size(), kBlockGrain, [&](std::size_t begin, std::size_t end, int worker) {
      Surroundings& near = scratch[worker];
      for (std::size_t b = begin; b < end; ++b) {
        if (gather(dipoles, blocks, b, level, near)) {
          couple_block(near, level, last, found[begin / kBlockGrain]);
        }
      }
      add_up(found[begin / kBlockGrain]);
    });
    for (const std::vector<Coupling>& some : found) {
      couplings_.insert(couplings_.end(), some.begin(), some.end());
    }
    add_up(couplings_);
    return !last;
  }

  /// Finds the dipoles in and around a block; false if all are of one sheet.
  static bool gather(const std::vector<WindingDipole>& dipoles,
                     const std::vector<CellBlock>& blocks, std::size_t b, int level,
                     Surroundings& near) {
    const CellBlock& block = blocks[b];
    bool alone = block.sheet != PointSheets::kNone;
    near.entry.clear();
    const std::array<std::uint32_t, 3> at = coordinates(block.code);
    for (std::uint32_t n = 0; n < 27; ++n) {
      // One less than 0 is above all coordinates, too.
      const std::uint32_t x = at[0] + n % 3 - 1;
      const std::uint32_t y = at[1] + n / 3 % 3 - 1;
      const std::uint32_t z = at[2] + n / 9 - 1;
      if (std::max({x, y, z}) >= (1U << WindingGrid::kLevels)) continue;
      const std::uint64_t code = morton_code(x, y, z);
      const auto other = std::lower_bound(
          blocks.begin(), blocks.end(), code,
          [](const CellBlock& one, std::uint64_t wanted) { return one.code < wanted; });
      if (other == blocks.end() || other->code != code) continue;
      alone = alone && other->sheet == block.sheet;
      for (const std::uint32_t i : other->dipole) {
        near.entry.emplace_back(dipoles[i].sheet, i, other->code == block.code);
      }
    }
    if (alone) return false;
    std::sort(near.entry.begin(), near.entry.end());
    near.dipole.resize(near.entry.size());
    const double length = std::ldexp(1.0, -level);
    const Vec3d corner = (1 << kBlockLevels) * Vec3d(at[0], at[1], at[2]);
    for (std::size_t k = 0; k < near.entry.size(); ++k) {
      const WindingDipole& d = dipoles[near.entry[k].dipole()];
      const Vec3f c = (d.center * length - corner).cast<float>();
      const Vec3f m = (d.moment * (length * length)).cast<float>();
      near.dipole.x[k] = c.x();
      near.dipole.y[k] = c.y();
      near.dipole.z[k] = c.z();
      near.dipole.p[k] = m.x();
      near.dipole.q[k] = m.y();
      near.dipole.r[k] = m.z();
    }
    return true;
  }

  /// Adds the energies between each of a block's sheets and those with higher numbers around it.
  static void couple_block(Surroundings& near, int level, bool last, std::vector<Coupling>& out) {
    const std::size_t count = near.entry.size();
    for (std::size_t begin = 0, end = 0; begin < count; begin = end) {
      const std::uint32_t sheet = near.entry[begin].sheet();
      while (end < count && near.entry[end].sheet() == sheet) ++end;
      near.row.clear();
      for (std::size_t i = begin; i < end; ++i) {
        if (!near.entry[i].own()) continue;
        dipole_energies(i, end, count, last, near.dipole);
        std::size_t column = 0;
        for (std::size_t k = end; k < count; ++column) {
          const std::uint32_t other = near.entry[k].sheet();
          if (column == near.row.size()) near.row.push_back({sheet, other, 0, 0});
          Coupling& c = near.row[column];
          for (; k < count && near.entry[k].sheet() == other; ++k) {
            const auto energy = static_cast<double>(near.dipole.energy[k]);
            c.sum += energy;
            c.size += std::abs(energy);
          }
        }
      }
      // Energies are lengths: of cells of the level, now in finest cells.
      for (const Coupling& c : near.row) {
        out.push_back({c.a, c.b, std::ldexp(c.sum, level), std::ldexp(c.size, level)});
      }
    }
  }

  static std::array<std::uint32_t, 3> coordinates(std::uint64_t code) {
    std::array<std::uint32_t, 3> out{};
    for (unsigned bit = 0; bit < unsigned{WindingGrid::kLevels}; ++bit) {
      for (unsigned d = 0; d < 3; ++d) {
        out[d] |= static_cast<std::uint32_t>(code >> (3 * bit + d) & 1) << bit;
      }
    }
    return out;
  }

  /// Joins sheets, the largest energy first, whose terms do not cancel.
  void join() {
    struct Value {
      double sum = 0, size = 0;
    };
    struct Best {
      double strength;
      std::uint32_t a, b;
      double sum;
      bool operator<(const Best& o) const {
        return strength != o.strength ? strength < o.strength
                                      : std::pair(a, b) > std::pair(o.a, o.b);
      }
    };
    struct Vector {
      Vec3d moment{0, 0, 0};
      double area = 0;
      bool closed() const { return moment.norm() <= (1 - kClosed) * area; }
    };
    std::vector<Vector> vector(count_);
    for (const WindingDipole& d : finest_) {
      vector[d.sheet].moment += d.moment;
      vector[d.sheet].area += d.area;
    }
    std::vector<std::unordered_map<std::uint32_t, Value>> near(count_);
    std::priority_queue<Best> queue;
    const auto push = [&](std::uint32_t a, std::uint32_t b, const Value& v) {
      if (std::abs(v.sum) > kLeastConsensus * v.size) {
        queue.push({std::abs(v.sum), std::min(a, b), std::max(a, b), v.sum});
      }
    };
    for (const Coupling& c : couplings_) {
      near[c.a][c.b] = near[c.b][c.a] = {c.sum, c.size};
      push(c.a, c.b, {c.sum, c.size});
    }
    while (!queue.empty()) {
      const Best best = queue.top();
      queue.pop();
      const auto found = near[best.a].find(best.b);
      if (found == near[best.a].end() || found->second.sum != best.sum) continue;
      if (best.strength < kLeastOfClosed * found->second.size && vector[best.a].closed() &&
          vector[best.b].closed()) {
        continue;
      }
      const bool differ = best.sum > 0;
      const bool more = near[best.a].size() >= near[best.b].size();
      const std::uint32_t kept = more ? best.a : best.b;
      const std::uint32_t gone = more ? best.b : best.a;
      sets_.unite(kept, gone, [&] { return differ; });
      const std::unordered_map<std::uint32_t, Value> moved = std::exchange(near[gone], {});
      near[kept].erase(gone);
      vector[kept].moment += (differ ? -1 : 1) * vector[gone].moment;
      vector[kept].area += vector[gone].area;
      for (const auto& [k, v] : moved) {
        if (k == kept) continue;
        Value& sum = near[kept][k];
        sum.sum += differ ? -v.sum : v.sum;
        sum.size += v.size;
        near[k].erase(gone);
        near[k][kept] = sum;
        push(kept, k, sum);
      }
    }
    turned_.resize(count_);
    for (std::uint32_t k = 0; k < count_; ++k) turned_[k] = sets_.find(k).opposed ? 1 : 0;
  }

  /// Turns single sheets as long as that takes energy away, and tells how certain each is.
  void descend() {
    std::vector<double> energy(count_);  // Of each sheet with all others.
    const Grouped<std::uint32_t> of = group_by_key<std::uint32_t>(count_, [&](const auto& add) {
      for (std::uint32_t k = 0; k < couplings_.size(); ++k) {
        add(couplings_[k].a, k);
        add(couplings_[k].b, k);
      }
    });
    const auto term = [&](const Coupling& c) {
      return turned_[c.a] == turned_[c.b] ? c.sum : -c.sum;
    };
    for (const Coupling& c : couplings_) {
      energy[c.a] += term(c);
      energy[c.b] += term(c);
    }
    for (int round = 0; round < kDescentRounds; ++round) {
      bool any = false;
      for (std::uint32_t k = 0; k < count_; ++k) {
        if (!(energy[k] > 0)) continue;
        any = true;
        energy[k] = -energy[k];
        turned_[k] ^= 1;
        for (std::uint64_t e = of.begin[k]; e < of.begin[k + 1]; ++e) {
          const Coupling& c = couplings_[of.item[e]];
          energy[c.a == k ? c.b : c.a] += 2 * term(c);
        }
      }
      if (!any) break;
    }
    std::vector<double> size(count_);
    for (const Coupling& c : couplings_) {
      size[c.a] += std::abs(c.sum);
      size[c.b] += std::abs(c.sum);
    }
    certainty_.resize(count_);
    for (std::uint32_t k = 0; k < count_; ++k) {
      certainty_[k] =
          size[k] > 0 ? static_cast<float>(std::clamp(-energy[k] / size[k], 0.0, 1.0)) : 1;
    }
  }

  /// The parts of sheets that were joined, and their sides.
  WindingSides parts() {
    WindingSides out;
    out.sheet.resize(count_);
    std::vector<std::uint32_t> number(count_, PointSheets::kNone);
    for (std::uint32_t k = 0; k < count_; ++k) {
      const SignedSets::Root root = sets_.find(k);
      if (number[root.index] == PointSheets::kNone) {
        number[root.index] = static_cast<std::uint32_t>(out.part.size());
        out.part.emplace_back();
      }
      out.sheet[k] = {number[root.index], turned_[k] != 0, certainty_[k]};
    }
    std::vector<WindingDipole> whole(out.part.size());
    for (const WindingDipole& d : finest_) {
      const WindingSides::Sheet& sheet = out.sheet[d.sheet];
      whole[sheet.part].add(d, sheet.turned);
    }
    const std::vector<bool> within = cavities(out, whole);
    for (std::size_t n = 0; n < whole.size(); ++n) {
      const WindingDipole& d = whole[n];
      out.part[n].area = d.area * cell_ * cell_;
      out.part[n].closed = d.area > 0 ? 1 - d.moment.norm() / d.area : 0;
      // Of open parts a volume says little, and most of the area looks one way.
      out.part[n].turned = out.part[n].closed >= kLeastClosed
                               ? (d.volume - d.moment.dot(d.center) < 0) != within[n]
                               : d.moment.z() < 0;
    }
    return out;
  }

  /// Which parts are within an odd number of others.
  std::vector<bool> cavities(const WindingSides& sides, const std::vector<WindingDipole>& whole) {
    std::vector<bool> within(whole.size());
    if (whole.size() < 2) return within;
    std::vector<std::uint32_t> largest(whole.size());
    for (std::uint32_t n = 0; n < whole.size(); ++n) largest[n] = n;
    std::stable_sort(largest.begin(), largest.end(), [&](std::uint32_t a, std::uint32_t b) {
      return whole[a].area > whole[b].area;
    });
    if (largest.size() > kMostEnclosing) largest.resize(kMostEnclosing);
    if (coarse_.size() > kMostEnclosing) {
      std::stable_sort(
          coarse_.begin(), coarse_.end(),
          [](const WindingDipole& a, const WindingDipole& b) { return a.area > b.area; });
      coarse_.resize(kMostEnclosing);
    }
    std::vector<std::vector<std::uint32_t>> of(whole.size());  // Coarse dipoles of each part.
    for (std::uint32_t i = 0; i < coarse_.size(); ++i) {
      of[sides.sheet[coarse_[i].sheet].part].push_back(i);
    }
    std::vector<std::vector<Vec3d>> places(whole.size());
    std::vector<std::size_t> seen(whole.size()), dipoles(whole.size());
    for (const WindingDipole& d : finest_) ++dipoles[sides.sheet[d.sheet].part];
    for (const WindingDipole& d : finest_) {
      const std::uint32_t n = sides.sheet[d.sheet].part;
      const std::size_t step = (dipoles[n] + kPlaces - 1) / kPlaces;
      if (seen[n]++ % step == step / 2) places[n].push_back(d.center);
    }
    const double eps = static_cast<double>(kDipoleBlur) * std::ldexp(1.0, coarse_level_);
    std::vector<std::uint8_t> odd(largest.size());
    parallel_each(largest.size(), 1, [&](std::size_t k) {
      const std::uint32_t n = largest[k];
      if (places[n].empty()) return;
      for (std::uint32_t other = 0; other < whole.size(); ++other) {
        if (other == n || of[other].empty() || whole[other].area < 0.01 * whole[n].area) continue;
        double inside = 0;
        for (const Vec3d& place : places[n]) {
          double winding = 0;
          for (const std::uint32_t i : of[other]) {
            const WindingDipole& d = coarse_[i];
            const Vec3d to = d.center - place;
            const double r2 = to.squaredNorm() + eps * eps;
            const bool opposed = sides.sheet[d.sheet].turned;
            winding += (opposed ? -1 : 1) * to.dot(d.moment) / (r2 * std::sqrt(r2));
          }
          inside += std::abs(winding) / (4 * std::numbers::pi);
        }
        if (inside > 0.5 * static_cast<double>(places[n].size())) odd[k] ^= 1;
      }
    });
    for (std::size_t k = 0; k < largest.size(); ++k) within[largest[k]] = odd[k] != 0;
    return within;
  }

  std::uint32_t count_;  ///< Sheets.
  double cell_;          ///< Edge of the finest cells, units.
  std::vector<WindingDipole> finest_;
  SignedSets sets_;
  std::vector<Coupling> couplings_;
  std::vector<std::uint8_t> turned_;  ///< Sheets.
  std::vector<float> certainty_;
  std::vector<WindingDipole> coarse_;  ///< The dipoles of the finest level with few.
  int coarse_level_ = 0;
};

}  // namespace

WindingSides winding_sides(const WindingDipoles& points) { return WindingSolver(points).run(); }

}  // namespace surfel
