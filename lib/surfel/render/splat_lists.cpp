#include <Eigen/Geometry>
#include <algorithm>
#include <array>
#include <bit>
#include <cmath>
#include <limits>
#include <optional>
#include <utility>

#include <surfel/base/elementary.h>
#include <surfel/base/error.h>
#include <surfel/base/parallel.h>
#include <surfel/lod/cut.h>
#include <surfel/render/clip_kernel.h>
#include <surfel/render/exact_kernel.h>
#include <surfel/render/splat_lists.h>

namespace surfel {
namespace {

/// A block's splats should fit a core's second-level cache and leave room for other data.
constexpr double kBlockSplats = 24000;
/// Blocks that a band has at least, for the threads to share. Each block sets up all splats that
/// reach into it: where each reaches over more than kWideShare of the band, fewer blocks do.
constexpr std::size_t kLeastBlocks = 64;
constexpr std::size_t kLeastBlocksOfWide = 16;
constexpr double kWideShare = 0.25;
/// Most splats of a block: places of their fields, in floats, fit 32 bits with a sign.
constexpr std::size_t kMostSplats = std::size_t{1} << 27;
/// Splats of a block for which there is room at once, if it may have as many.
constexpr std::size_t kFirstSplats = std::size_t{1} << 19;
/// A group that enlarges a disc by less than this factor leaves it as it was, within rounding.
constexpr float kLeastEnlargement = 1 + 1e-3F;
constexpr float kNoSplat = std::numeric_limits<float>::quiet_NaN();

/// Whether a splat covers a tile that it meets, or may.
bool is_large(const PixelBox& box) {
  return box.x1 - box.x0 >= kTileSize && box.y1 - box.y0 >= kTileSize;
}

/// Patches with no more sheets than this are sorted by insertion, which takes no memory.
constexpr std::ptrdiff_t kFewSheets = 32;

/// The rules of a list that a cloud has the columns for.
SplatListOptions possible(SplatListOptions lists, const RenderCloud& cloud) {
  lists.enlarged = lists.enlarged && !cloud.group_radius.empty();
  return lists;
}

}  // namespace

BlockGrid::BlockGrid(const Band& band, std::size_t surfels, double share) {
  const std::size_t least = share > kWideShare ? kLeastBlocksOfWide : kLeastBlocks;
  const auto make = [&](int s) {
    shift = s;
    blocks_x = (band.tiles_x + (1 << s) - 1) >> s;
    blocks_y = (band.tiles_y + (1 << s) - 1) >> s;
  };
  constexpr int kMostShift = std::bit_width(static_cast<unsigned>(kMostBlockSize / kTileSize)) - 1;
  for (int s = kMostShift; s >= 1; --s) {
    make(s);
    if (blocks() >= least &&
        static_cast<double>(surfels) <= kBlockSplats * static_cast<double>(blocks())) {
      return;
    }
  }
}

SplatLists::SplatLists(const RenderCloud& cloud, const Scene& scene, const RenderOptions& options,
                       const ABufferLayout& layout, const SplatListOptions& lists)
    : cloud_(cloud),
      scene_(scene),
      options_(options),
      layout_(layout),
      lists_(possible(lists, cloud)),
      culling_(cloud, options, lists_) {
  rules_ = {.cutoff = static_cast<float>(options.cutoff),
            .lowpass2 = static_cast<float>(lists.lowpass * lists.lowpass),
            .depth_epsilon = static_cast<float>(options.epsilon_share()),
            .opaque = layout.opaque};
  if ((!layout.opaque || !options.method) && !lists.groups && !lists.enlarged) {
    surfaces_.emplace(cloud, layout.opaque, lists.sheets);
  }
  materials_fade_ = std::any_of(scene.materials.begin(), scene.materials.end(),
                                [](const Material& m) { return m.opacity != 1; });
  if (cloud.has_levels()) covering_ = covering_variance(options.lod_pixels(), lists.lowpass);
}

/// The factor on a surfel's standard deviations that gives its disc the radius that its group asks
/// for.
float SplatLists::enlargement(std::size_t surfel) const {
  return cloud_.group_radius[surfel] /
         (std::sqrt(2 * band_view().cutoff) * cloud_.larger_deviation(surfel));
}

/// The surfels with the deviations that they are drawn with.
SurfelColumns SplatLists::columns_of(const Cluster& cluster, Worker& worker) const {
  SurfelColumns surfels = surfel_columns(cloud_, cluster);
  const bool widened = covering_ > 0;
  if (!lists_.enlarged && !widened) return surfels;
  const auto change = [&](const Array<float>& deviation, Array<float>& out) {
    out.assign(RenderCloud::kClusterSize + RenderCloud::kPadding, 0.0F);
    if (widened) {
      for (std::uint32_t i = cluster.begin; i < cluster.end; ++i) {
        out[i - cluster.begin] = std::max(deviation[i], covering_deviation(cluster, i));
      }
    } else {
      enlarge(cluster, deviation, out.data());
    }
    return out.data();
  };
  surfels.deviation_u = change(cloud_.deviation_u, worker.deviation_u);
  if (cloud_.anisotropic()) surfels.deviation_v = change(cloud_.deviation_v, worker.deviation_v);
  return surfels;
}

/// Standard deviations with which a cluster's discs have the radii that their groups ask for.
void SplatLists::enlarge(const Cluster& cluster, const Array<float>& deviation, float* out) const {
  // Splats are not set up of surfels whose deviation is no number.
  const bool added_alone = lists_.surfels == ListedSurfels::kAdditions && !cluster.copies;
  const float least = added_alone ? kLeastEnlargement : 0;
  const float inv_reach = 1 / std::sqrt(2 * band_view().cutoff);
  const float* const radius = cloud_.group_radius.data();
  const float* const u = cloud_.deviation_u.data();
  const float* const v = (cloud_.anisotropic() ? cloud_.deviation_v : cloud_.deviation_u).data();
  const float* const from = deviation.data();
  for (std::uint32_t i = cluster.begin; i < cluster.end; ++i) {
    const float factor = radius[i] * inv_reach / std::max(u[i], v[i]);
    out[i - cluster.begin] = factor > least ? from[i] * factor : kNoSplat;
  }
}

float SplatLists::covering_deviation(const Cluster& cluster, std::size_t surfel) const {
  return cluster.merged ? std::sqrt(covering_ * cloud_.area[surfel]) : 0.0F;
}

/// Surfel in camera space, in double; an unknown normal looks at the eye.
SurfelInCamera SplatLists::in_camera(const Cluster& cluster, std::size_t surfel) const {
  SurfelInCamera s;
  const Camera& camera = frame_->camera;
  const Eigen::Matrix3d& rotation = camera.camera_from_world;
  s.position = rotation * (cloud_.origin() - camera.eye +
                           Vec3d(cloud_.x[surfel], cloud_.y[surfel], cloud_.z[surfel]));
  s.normal =
      rotation * Vec3d(cloud_.normal_x[surfel], cloud_.normal_y[surfel], cloud_.normal_z[surfel]);
  s.normal = s.normal.isZero(0) ? Vec3d(-s.position.normalized()) : Vec3d(s.normal.normalized());
  const double scale = lists_.enlarged ? enlargement(surfel) : 1;
  const double least = covering_deviation(cluster, surfel);
  s.variance_u = portable::squared(std::max<double>(scale * cloud_.deviation_u[surfel], least));
  s.variance_v = s.variance_u;
  s.tangent = s.normal.unitOrthogonal();
  if (cloud_.anisotropic()) {
    s.variance_v = portable::squared(std::max<double>(scale * cloud_.deviation_v[surfel], least));
    const Vec3d t = rotation * Vec3d(cloud_.tangent_x[surfel], cloud_.tangent_y[surfel],
                                     cloud_.tangent_z[surfel]);
    s.tangent = (t - s.normal * s.normal.dot(t)).normalized();
  }
  s.area = cloud_.area[surfel];
  for (std::size_t j = 0; j < cloud_.clip.size(); ++j) {
    const RenderCloud::ClipColumns& clip = cloud_.clip[j];
    if (!cloud_.clips(clip, surfel)) continue;
    const Vec3d direction = rotation * Vec3d(clip.x[surfel], clip.y[surfel], clip.z[surfel]);
    s.clip[j] = {(direction - s.normal * s.normal.dot(direction)).normalized(),
                 clip.distance[surfel]};
  }
  return s;
}

void SplatLists::reserve(Worker& worker, std::size_t more, std::size_t most) const {
  const auto grow = [&](auto& array, std::size_t count, std::size_t least) {
    const std::size_t needed = count + more;
    if (array.size() < needed) array.resize(std::max({needed, 2 * array.size(), least}));
  };
  // Only the touched pages of a block of memory of its own count, so that reserving it from the
  // start costs less than moving the splats as their number grows.
  const std::size_t all = std::min(most, kFirstSplats);
  grow(worker.splats, worker.count, all);
  if (layout_.normals) grow(worker.normals, worker.count, all);
  if (lists_.groups) grow(worker.groups, worker.count, all);
  if (std::isfinite(band_view().tolerance)) grow(worker.exact, worker.count, all);
  if (cloud_.has_clips()) grow(worker.clips, worker.count, all);
  for (TileList& list : worker.tiles) {
    grow(list.splats, list.count, 0);
    grow(list.depths, list.count + kTileSize, 0);
  }
}

/// Completes the splats from `begin` on, which lack only the values of their materials. `surfels`
/// has their surfels.
void SplatLists::complete(std::size_t place, std::size_t begin, const std::uint32_t* surfels,
                          Worker& worker) {
  const std::size_t count = worker.count - begin;
  Splat* const splats = worker.splats.data() + begin;
  const std::uint32_t flags = surfaces_ && surfaces_->is_flat(place) ? kFlatTag : 0;
  for (std::size_t i = 0; i < count && flags != 0; ++i) splats[i].tag |= flags;
  for (std::size_t i = 0; i < count && !cloud_.material.empty(); ++i) {
    splats[i].tag |= std::uint32_t{cloud_.material[surfels[i]]} << kMaterialShift;
  }
  for (std::size_t i = 0; i < count && materials_fade_; ++i) {
    const std::size_t material = splats[i].tag >> kMaterialShift;
    const float opacity = scene_.materials[std::min(material, scene_.materials.size() - 1)].opacity;
    for (float* channel : {&splats[i].red, &splats[i].green, &splats[i].blue, &splats[i].alpha}) {
      *channel *= opacity;
    }
  }
  if (layout_.normals) {
    SplatNormal* const normals = worker.normals.data() + begin;
    const bool mapped = cloud_.has_shading();
    const float* const x = (mapped ? cloud_.shading_x : cloud_.normal_x).data();
    const float* const y = (mapped ? cloud_.shading_y : cloud_.normal_y).data();
    const float* const z = (mapped ? cloud_.shading_z : cloud_.normal_z).data();
    for (std::size_t i = 0; i < count; ++i) {
      normals[i] = {x[surfels[i]], y[surfels[i]], z[surfels[i]]};
    }
  }
  for (std::size_t i = 0; i < count && lists_.groups; ++i) {
    worker.groups[begin + i] = cloud_.group[surfels[i]];
  }
}

/// Adds a sheet's splats, tag by tag: splats of several tags in one sum would all have the first
/// one's. At a silhouette the order is front to back.
/// \param members  of the sheet; gets reordered.
/// \param surfels  of the splats.
void SplatLists::add_by_tags(const SplatView& view, const SheetSplats& sheet,
                             std::uint32_t* members, const std::uint32_t* surfels,
                             Worker& worker) const {
  const auto rank = [&](std::uint32_t member) {
    const std::uint32_t tag = sheet.splats[member].tag;
    const bool grazing = (tag & kGrazingTag) != 0;
    const std::uint32_t depth = (tag & kFrontTag) != 0 ? (grazing ? 1 : 0) : (grazing ? 2 : 3);
    // Splats that lie apart by a step more may be in one sum.
    return depth << kSpacingShift | (tag & ((1U << kSpacingShift) - 1));
  };
  for (std::size_t begin = 0; begin < sheet.count;) {
    std::uint32_t least = rank(members[begin]);
    bool several = false;
    for (std::size_t i = begin + 1; i < sheet.count; ++i) {
      const std::uint32_t other = rank(members[i]);
      several = several || other != least;
      least = std::min(least, other);
    }
    const std::uint32_t* end = members + sheet.count;
    if (several) {
      end = std::stable_partition(members + begin, members + sheet.count,
                                  [&](std::uint32_t member) { return rank(member) == least; });
    }
    SheetSplats part = sheet;
    part.members = members + begin;
    part.count = static_cast<std::size_t>(end - part.members);
    const std::size_t used = worker.sheets.used;
    add_sheet(rules_, view, part, worker.sheets);
    if (notes_surfels_ && worker.sheets.used > used) {
      NotedSheet& noted = worker.noted_sheets.emplace_back();
      noted.first = static_cast<std::uint32_t>(used / kPatchPixels);
      noted.end = static_cast<std::uint32_t>(worker.sheets.used / kPatchPixels);
      for (std::size_t i = 0; i < part.count; ++i) {
        noted.splats.push_back(sheet.splats[part.members[i]]);
        noted.surfels.push_back(surfels[part.members[i]]);
      }
    }
    begin += part.count;
  }
}

/// Sums up the splats from `begin` on that are of the cluster's sheets, and leaves the others.
/// `surfels` has their surfels.
void SplatLists::take_sheets(std::size_t place, const SplatView& view, std::size_t begin,
                             const std::uint32_t* surfels, Worker& worker) {
  if (!surfaces_ || surfaces_->sheets(place).empty()) return;
  const std::uint32_t first = cloud_.clusters()[clusters_[place].index].begin;
  const std::size_t count = worker.count - begin;
  // Exact kernels, which come last, are of large splats.
  const auto affine = static_cast<std::size_t>(worker.set_up.visible_count);
  const Splat* const splats = worker.splats.data() + begin;
  std::uint8_t taken[kSetupSurfels] = {};
  for (const SheetInView& sheet : surfaces_->sheets(place)) {
    std::uint32_t members[kSetupSurfels];
    SheetSplats in_block{.splats = splats,
                         .normals = layout_.normals ? worker.normals.data() + begin : nullptr,
                         .members = members,
                         .depth = sheet.depth};
    std::size_t found = 0;
    for (std::size_t i = 0; i < affine; ++i) {
      const bool is_member = has_surfel(sheet.surfels, surfels[i] - first);
      members[found] = static_cast<std::uint32_t>(i);
      found += is_member ? 1 : 0;
      taken[i] |= is_member ? 1 : 0;
    }
    in_block.count = found;
    add_by_tags(view, in_block, members, surfels, worker);
  }
  for (const SheetSums::Patch& patch : worker.sheets.patches) {
    TileList& list =
        worker.tiles[((patch.y / kTileSize) << frame_->grid.shift) + patch.x / kTileSize];
    list.sheets.push_back(patch.sheet);
  }
  worker.sheets.patches.clear();
  std::size_t to = begin;
  for (std::size_t i = 0; i < count; ++i) {
    if (taken[i] != 0) continue;
    const std::size_t from = begin + i;
    worker.splats[to] = worker.splats[from];
    if (layout_.normals) worker.normals[to] = worker.normals[from];
    if (worker.splats[to].k < 0) worker.exact[to] = worker.exact[from];
    if ((worker.splats[to].tag & kClippedTag) != 0) worker.clips[to] = worker.clips[from];
    if (notes_surfels_) worker.surfels[to] = worker.surfels[from];
    ++to;
  }
  worker.count = to;
}

const NotedSheet& SplatLists::sheet_of(const SheetPatch& sheet, int worker) {
  const std::vector<NotedSheet>& noted = workers_[worker].noted_sheets;
  return *std::upper_bound(noted.begin(), noted.end(), sheet.sums,
                           [](std::uint32_t sums, const NotedSheet& n) { return sums < n.end; });
}

/// Sorts a tile's sheets by patch, and the sheets of a patch nearest first.
void SplatLists::sort_sheets(TileList& list) {
  std::array<std::uint32_t, kTilePixels / kPatchPixels + 1>& begin = list.sheets_begin;
  begin.fill(0);
  for (const SheetPatch& sheet : list.sheets) ++begin[sheet.patch + 1];
  for (std::size_t i = 1; i < begin.size(); ++i) begin[i] += begin[i - 1];
  list.sorted_sheets.resize(list.sheets.size());
  std::array<std::uint32_t, kTilePixels / kPatchPixels + 1> end = begin;
  for (const SheetPatch& sheet : list.sheets) {
    list.sorted_sheets[end[sheet.patch]++] = sheet;
  }
  const auto nearer = [](const SheetPatch& a, const SheetPatch& b) { return a.depth > b.depth; };
  for (std::size_t i = 0; i + 1 < begin.size(); ++i) {
    SheetPatch* const first = list.sorted_sheets.data() + begin[i];
    SheetPatch* const last = list.sorted_sheets.data() + begin[i + 1];
    if (last - first > kFewSheets) {
      std::stable_sort(first, last, nearer);
      continue;
    }
    // The clusters come nearest first, and most of their sheets do.
    for (SheetPatch* at = first; at < last; ++at) {
      std::rotate(std::upper_bound(first, at, *at, nearer), at, at + 1);
    }
  }
}

/// Lists the splats from `begin` on in the tiles that they touch.
void SplatLists::add_splats(std::size_t begin, Worker& worker) {
  const std::size_t count = worker.count - begin;
  const Splat* const splats = worker.splats.data() + begin;
  TileList* const tiles = worker.tiles.data();
  for (std::size_t i = 0; i < count; ++i) {
    bool large = false;
    const auto put = [&](int x, int y) {
      TileList& list = tiles[(y << frame_->grid.shift) + x];
      list.splats[list.count] = static_cast<std::uint32_t>(begin + i);
      list.depths[list.count++] = splats[i].depth;
      list.large += large ? 1 : 0;
      list.clipped += (splats[i].tag & kClippedTag) != 0 ? 1 : 0;
    };
    const PixelBox box = splats[i].box;
    large = is_large(box);
    if (large && box == worker.block) {
      worker.covering.push_back(static_cast<std::uint32_t>(begin + i));
      worker.clipped_covering += (splats[i].tag & kClippedTag) != 0 ? 1 : 0;
      continue;
    }
    const int x0 = box.x0 / kTileSize;
    const int y0 = box.y0 / kTileSize;
    const int x1 = box.x1 / kTileSize;
    const int y1 = box.y1 / kTileSize;
    if (x0 == x1 && y0 == y1) {  // Most, where splats are small.
      put(x0, y0);
      continue;
    }
    for (int y = y0; y <= y1; ++y) {
      for (int x = x0; x <= x1; ++x) put(x, y);
    }
  }
}

void SplatLists::bin(const Frame& frame, std::span<const VisibleCluster> clusters) {
  frame_ = &frame;
  const BlockGrid& grid = frame.grid;
  clusters_ = clusters.data();
  tiles_.resize(clusters.size());
  constexpr std::size_t kGrain = 256;
  parallel_each(clusters.size(), kGrain, [&](std::size_t i) {
    tiles_[i] = culling_.tiles_of(cloud_.clusters()[clusters[i].index]);
  });
  if (surfaces_) surfaces_->begin(clusters, band_view(), rules_.depth_epsilon);
  block_begin_.resize(grid.blocks() + 1);
  std::fill(block_begin_.begin(), block_begin_.end(), 0U);
  const auto for_each_block = [&](const TileRange& c, const auto& body) {
    for (int y = c.y0 >> grid.shift; y <= c.y1 >> grid.shift; ++y) {
      for (int x = c.x0 >> grid.shift; x <= c.x1 >> grid.shift; ++x) body(y * grid.blocks_x + x);
    }
  };
  std::size_t sum = 0;
  for (const TileRange& tiles : tiles_) {
    for_each_block(tiles, [&](int block) {
      ++block_begin_[block];
      ++sum;
    });
  }
  if (sum > std::numeric_limits<std::uint32_t>::max()) {
    throw Error(ErrorKind::kNumeric, "the splats are too large on screen; move the camera back");
  }
  std::uint32_t begin = 0;
  for (std::uint32_t& entry : block_begin_) begin += std::exchange(entry, begin);
  block_clusters_.resize(sum);
  // Entries become ends, which are the beginnings one block further.
  for (std::size_t i = 0; i < clusters.size(); ++i) {
    for_each_block(tiles_[i], [&](int block) {
      block_clusters_[block_begin_[block]++] = static_cast<std::uint32_t>(i);
    });
  }
  std::copy_backward(block_begin_.begin(), block_begin_.end() - 1, block_begin_.end());
  block_begin_[0] = 0;
}

void SplatLists::load(std::size_t block, std::size_t begin, std::size_t end, int worker) {
  Worker& w = workers_[worker];
  if ((end - begin) * RenderCloud::kClusterSize > kMostSplats) {
    throw Error(
        ErrorKind::kNumeric,
        "more than 134 million surfels are seen in a few pixels, more than this method draws; "
        "use `method` abuffer");
  }
  SplatView view = band_view();
  const int tile_x = frame_->grid.first_tile_x(block);
  const int tile_y = frame_->grid.first_tile_y(block);
  view.first_column = tile_x == 0;
  view.first_row = tile_y == 0;
  view.clip_x0 = static_cast<float>(tile_x * kTileSize);
  view.clip_y0 = band_view().clip_y0 + static_cast<float>(tile_y * kTileSize);
  view.clip_x1 =
      std::min(band_view().clip_x1, view.clip_x0 + static_cast<float>(frame_->grid.size()));
  view.clip_y1 =
      std::min(band_view().clip_y1, view.clip_y0 + static_cast<float>(frame_->grid.size()));
  const ExactKernelView exact_view{.cutoff = options_.cutoff,
                                   .lowpass = lists_.lowpass,
                                   .margin = lists_.margin,
                                   .x0 = view.clip_x0,
                                   .y0 = view.clip_y0,
                                   .x1 = view.clip_x1,
                                   .y1 = view.clip_y1,
                                   .first_column = view.first_column,
                                   .first_row = view.first_row};
  w.count = 0;
  ++w.loads;
  w.tiles.resize(std::size_t{1} << 2 * frame_->grid.shift);
  for (TileList& list : w.tiles) {
    list.count = list.large = list.clipped = 0;
    list.sheets.clear();
  }
  w.sheets.used = 0;
  w.noted_sheets.clear();
  w.covering.clear();
  w.clipped_covering = 0;
  w.block = {0, 0, static_cast<std::uint8_t>(view.clip_x1 - view.clip_x0 - 1),
             static_cast<std::uint8_t>(view.clip_y1 - view.clip_y0 - 1)};
  const std::uint32_t* const places = block_clusters_.data() + block_begin_[block];
  const auto cluster_at = [&](std::size_t c) -> const Cluster& {
    return cloud_.clusters()[clusters_[places[c]].index];
  };
  // Clusters follow one another in depth, not in memory.
  constexpr std::size_t kAhead = 4;
  for (std::size_t c = begin; c < end; ++c) {
    const std::size_t place = places[c];
    const Cluster& cluster = cluster_at(c);
    const std::uint32_t i = cluster.begin;
    if (c + kAhead < end) __builtin_prefetch(&cluster_at(c + kAhead).begin);
    std::optional<SurfelColumns> ahead;
    if (c + 1 < end) ahead = surfel_columns(cloud_, cluster_at(c + 1));
    reserve(w, RenderCloud::kClusterSize, (end - begin) * RenderCloud::kClusterSize);
    SetUpSplats& set_up = w.set_up;
    SurfelColumns columns = columns_of(cluster, w);
    if (surfaces_) columns.uneven = surfaces_->unevenness(place);
    set_up_splats(view, columns, static_cast<int>(cluster.end - i), ahead ? &*ahead : nullptr,
                  w.splats.data() + w.count,
                  cloud_.has_clips() ? w.clips.data() + w.count : nullptr, set_up);
    w.splats_seen += static_cast<std::size_t>(set_up.first_count);
    const std::size_t first = w.count;
    std::array<std::uint32_t, RenderCloud::kClusterSize> surfels;
    for (int v = 0; v < set_up.visible_count; ++v) {
      surfels[v] = i + static_cast<std::uint32_t>(set_up.visible[v]);
    }
    w.count += static_cast<std::size_t>(set_up.visible_count);
    for (int v = 0; v < set_up.exact_count; ++v) {
      const std::size_t surfel = i + static_cast<std::size_t>(set_up.exact[v]);
      const std::optional<ExactKernel> kernel =
          make_exact_kernel(in_camera(cluster, surfel), frame_->camera, exact_view);
      if (!kernel) continue;
      w.exact[w.count] = kernel->exact;
      surfels[w.count - first] = static_cast<std::uint32_t>(surfel);
      Splat& splat = w.splats[w.count++];
      splat = kernel->splat;
      splat.alpha = cloud_.alpha.empty() ? 1.0F : cloud_.alpha[surfel];
      splat.red = cloud_.red[surfel] * splat.alpha;
      splat.green = cloud_.green[surfel] * splat.alpha;
      splat.blue = cloud_.blue[surfel] * splat.alpha;
      if (cloud_.is_clipped(surfel)) {
        splat.tag |= kClippedTag;
        w.clips[w.count - 1] = make_exact_clip(in_camera(cluster, surfel), frame_->camera);
      }
      w.splats_seen += kernel->first ? 1 : 0;
      w.exact_seen += kernel->first ? 1 : 0;
    }
    complete(place, first, surfels.data(), w);
    if (notes_surfels_) {
      w.surfels.resize(first);
      w.surfels.insert(w.surfels.end(), surfels.data(), surfels.data() + (w.count - first));
    }
    take_sheets(place, view, first, surfels.data(), w);
    add_splats(first, w);
  }
  w.loaded = w.count;
}

/// Adds the splats that cover the block to a tile's others, in the order of the worker's splats.
void SplatLists::add_covering(TileList& list, const Worker& worker) {
  std::size_t own = list.count;
  std::size_t covering = worker.covering.size();
  list.count += covering;
  list.clipped += worker.clipped_covering;
  if (list.splats.size() < list.count) list.splats.resize(list.count);
  if (list.depths.size() < list.count + kTileSize) list.depths.resize(list.count + kTileSize);
  for (std::size_t to = list.count; covering > 0;) {
    --to;
    if (own > 0 && list.splats[own - 1] > worker.covering[covering - 1]) {
      --own;
      list.splats[to] = list.splats[own];
      list.depths[to] = list.depths[own];
    } else {
      list.splats[to] = worker.covering[--covering];
      list.depths[to] = worker.splats[list.splats[to]].depth;
    }
  }
}

/// Leaves large_splats of the large splats of a tile, with so much more amplitude: their sum stays
/// nearly as it is, whatever their number, at a bounded cost. One is taken from each of equal
/// stretches of the splats that cover the block, and of the tile's others. Neighbours in space
/// follow each other there, so that the splats that stay are spread evenly in space, and tiles that
/// show the same splats leave the same. (docs/reliability.md tells how pictures change.)
void SplatLists::thin_out(TileList& list, Worker& worker) const {
  const std::size_t most = lists_.large_splats;
  const std::size_t large = worker.covering.size() + list.large;
  const float factor = static_cast<float>(large) / static_cast<float>(most);
  // The copies of the tile before are no longer needed.
  worker.count = worker.loaded;
  ++worker.loads;
  reserve(worker, most, 0);
  std::size_t kept = 0;
  const auto next = [&] { return (2 * kept + 1) * large / (2 * most); };
  // A splat of its own, as other tiles draw the splat with another amplitude.
  const auto keep = [&](std::uint32_t at) {
    ++kept;
    const std::size_t copy = worker.count++;
    worker.splats[copy] = worker.splats[at];
    worker.splats[copy].amplitude *= factor;
    if (worker.splats[at].k < 0) {
      worker.exact[copy] = worker.exact[at];
      worker.exact[copy].amplitude *= factor;
    }
    if ((worker.splats[at].tag & kClippedTag) != 0) worker.clips[copy] = worker.clips[at];
    if (layout_.normals) worker.normals[copy] = worker.normals[at];
    if (lists_.groups) worker.groups[copy] = worker.groups[at];
    if (notes_surfels_) {
      worker.surfels.resize(copy + 1);
      worker.surfels[copy] = worker.surfels[at];
    }
    return static_cast<std::uint32_t>(copy);
  };
  std::size_t left = 0;
  std::size_t seen = worker.covering.size();
  std::vector<std::uint32_t>& copies = worker.copies;
  copies.clear();
  while (next() < seen) copies.push_back(keep(worker.covering[next()]));
  for (std::size_t i = 0; i < list.count; ++i) {
    const std::uint32_t at = list.splats[i];
    if (!is_large(worker.splats[at].box)) {
      list.splats[left] = at;
      list.depths[left++] = list.depths[i];
    } else if (seen++ == next()) {
      copies.push_back(keep(at));
    }
  }
  for (const std::uint32_t copy : copies) {
    list.splats[left] = copy;
    list.depths[left++] = worker.splats[copy].depth;
  }
  worker.thinned += large - kept;
  list.count = left;
  list.clipped += worker.clipped_covering;
}

TileJob SplatLists::job(int x, int y, int worker) {
  Worker& w = workers_[worker];
  TileList& list = w.tiles[(y << frame_->grid.shift) + x];
  if (w.covering.size() + list.large > kMostLargeSplats) {
    thin_out(list, w);
  } else if (!w.covering.empty()) {
    add_covering(list, w);
  }
  if (w.order.size() < list.count + kTileSize) w.order.resize(2 * list.count + kTileSize);
  sort_front_to_back(list.depths.data(), list.splats.data(), list.count, lists_.order, w.sort,
                     w.order.data());
  if (!list.sheets.empty()) sort_sheets(list);
  return {.rules = &rules_,
          .splats = w.splats.data(),
          .normals = layout_.normals ? w.normals.data() : nullptr,
          .exact = w.exact.data(),
          .clips = list.clipped > 0 ? w.clips.data() : nullptr,
          .groups = lists_.groups ? w.groups.data() : nullptr,
          .order = w.order.data(),
          .count = list.count,
          .box_x = x * kTileSize,
          .box_y = y * kTileSize,
          .sheets = list.sheets.empty() ? nullptr : list.sorted_sheets.data(),
          .sheets_begin = list.sheets_begin.data(),
          .sheet_sums = w.sheets.sums.data(),
          .load = w.loads};
}

std::size_t SplatLists::take_splat_count() {
  std::size_t sum = 0;
  workers_.for_each([&](Worker& worker) { sum += std::exchange(worker.splats_seen, 0); });
  return sum;
}

std::uint64_t SplatLists::take_fragment_count() {
  std::uint64_t sum = 0;
  workers_.for_each([&](Worker& worker) { sum += std::exchange(worker.sheets.fragments, 0); });
  return sum;
}

std::size_t SplatLists::take_thinned_count() {
  std::size_t sum = 0;
  workers_.for_each([&](Worker& worker) { sum += std::exchange(worker.thinned, 0); });
  return sum;
}

std::size_t SplatLists::take_exact_count() {
  std::size_t sum = 0;
  workers_.for_each([&](Worker& worker) { sum += std::exchange(worker.exact_seen, 0); });
  return sum;
}

}  // namespace surfel
