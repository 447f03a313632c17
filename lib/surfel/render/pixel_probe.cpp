#include <algorithm>
#include <cmath>
#include <iterator>
#include <limits>
#include <numeric>
#include <optional>
#include <utility>

#include <surfel/render/pixel_probe.h>
#include <surfel/render/plain_pixels.h>

namespace surfel {
namespace {

constexpr float kNowhere = std::numeric_limits<float>::infinity();
constexpr float kNothingHidden = -kNowhere;

constexpr std::array<FragmentChannel, 3> kColorChannels{kRed, kGreen, kBlue};

/// The depth of the nearest of a pixel's fragments that cover it, if it is nearer than `depth`.
std::optional<float> depth_before(const TileABuffer& tile, const std::vector<Fragment>& fragments,
                                  float depth) {
  std::optional<float> nearest;
  for (const Fragment& fragment : fragments) {
    const float at = front_depth(fragment);
    if (covers(tile, fragment) && at > nearest.value_or(depth)) nearest = at;
  }
  return nearest;
}

Vec3f straight(const float* red, double alpha) {
  if (!(alpha > 0)) return {0, 0, 0};
  return Vec3f(red[0], red[1], red[2]) / static_cast<float>(alpha);
}

}  // namespace

PixelProbe::PixelProbe(const Camera& camera, const RenderCloud& cloud, int x, int y, bool replays)
    : cloud_(cloud), replays_(replays), unlit_(nullptr, camera) {
  result_.x = x;
  result_.y = y;
  pixel_ = tile_pixel(x % kTileSize, y % kTileSize);
}

bool PixelProbe::meets(int x0, int y0) const {
  return result_.x / kTileSize * kTileSize == x0 && result_.y / kTileSize * kTileSize == y0;
}

void PixelProbe::draw(const TileABuffer& tile, std::span<const TileJob> jobs,
                      std::span<SplatLists> lists, int worker, Compositor::Worker& compositor) {
  if (replays_) {
    replay(tile, jobs.front(), lists.front(), worker);
  } else {
    respond(tile, jobs, lists, worker, compositor);
  }
}

void PixelProbe::keep(const TileABuffer& tile, bool plain) {
  kept_tile_ = tile;
  plain_ = plain;
  kept_.assign(tile.data, tile.data + tile.layout.size());
  if (!replays_) return;
  // The layers that drop_hidden() drops.
  TileABuffer all = tile;
  all.data = state_.data();
  const Layers before = layers_of(all, pixel_);
  drop_hidden(all);
  const Layers after = layers_of(all, pixel_);
  std::vector<std::vector<Member>> kept;
  for (std::size_t layer = 0; layer < before.size(); ++layer) {
    const bool stays = kept.size() < after.size() &&
                       std::equal(std::begin(before[layer].channel),
                                  std::end(before[layer].channel), after[kept.size()].channel);
    if (stays) {
      kept.push_back(std::move(members_[layer]));
    } else {
      set_fate(members_[layer], SplatFate::kHidden);
    }
  }
  members_ = std::move(kept);
}

void PixelProbe::note(const Image& image, int stage) {
  std::copy_n(image.pixel(x(), y()), 4, stages_[static_cast<std::size_t>(stage)].begin());
}

bool PixelProbe::in_box(const TileJob& job, const PixelBox& box) const {
  const int in_block_x = job.box_x + x() % kTileSize;
  const int in_block_y = job.box_y + y() % kTileSize;
  return box.x0 <= in_block_x && in_block_x <= box.x1 && box.y0 <= in_block_y &&
         in_block_y <= box.y1;
}

bool PixelProbe::patch_in_box(const TileJob& job, const PixelBox& box) const {
  const int first_x = job.box_x + x() % kTileSize / kStripWidth * kStripWidth;
  const int first_y = job.box_y + y() % kTileSize / kStripWidth * kStripWidth;
  return box.x0 < first_x + kStripWidth && first_x <= box.x1 && box.y0 < first_y + kStripWidth &&
         first_y <= box.y1;
}

/// A job that draws one splat of another.
TileJob PixelProbe::single(const TileJob& job, std::uint32_t index) {
  one_.splat = job.splats[index];
  if (job.normals) one_.normal = job.normals[index];
  if (one_.splat.k < 0) one_.exact = job.exact[index];
  if (job.clips && (one_.splat.tag & kClippedTag) != 0) one_.clip = job.clips[index];
  TileJob out = job;
  out.splats = &one_.splat;
  out.normals = job.normals ? &one_.normal : nullptr;
  out.exact = &one_.exact;
  out.clips = job.clips ? &one_.clip : nullptr;
  out.groups = job.groups ? job.groups + index : nullptr;
  out.order = order_.data();
  out.count = 1;
  out.fragments = &fragments_;
  out.sheets = nullptr;
  return out;
}

/// A job that draws one sheet of another.
TileJob PixelProbe::single_sheet(const TileJob& job, const SheetPatch& sheet, bool normals) {
  const std::size_t channels = (normals ? kNormalZ : kSheetEpsilon) + 1;
  const float* const sums = job.sheet_sums + std::size_t{kPatchPixels} * sheet.sums;
  sheet_sums_.assign(sums, sums + channels * kPatchPixels);
  sheet_ = sheet;
  sheet_.sums = 0;
  for (std::size_t i = 0; i < sheet_begin_.size(); ++i) sheet_begin_[i] = i > sheet.patch ? 1 : 0;
  TileJob out = job;
  out.count = 0;
  out.order = order_.data();
  out.fragments = &fragments_;
  out.sheets = &sheet_;
  out.sheets_begin = sheet_begin_.data();
  out.sheet_sums = sheet_sums_.data();
  return out;
}

/// What a job makes of the pixel where there is nothing else.
Fragment PixelProbe::alone(const TileABuffer& tile, TileJob job) {
  TileABuffer blank = tile;
  blank.layout.layers = 1;
  blank_.assign(blank.layout.size(), 0.0F);
  blank.data = blank_.data();
  const RasterReplay open{
      .hidden = kNothingHidden, .least_to_merge = kNowhere, .epsilon = epsilon_.data()};
  job.replay = &open;
  rasterize_tile(job, blank);
  Fragment fragment;
  load_fragment(blank, 0, pixel_, fragment);
  return fragment;
}

/// Notes the splat of a single job. Returns its place.
/// \param row  of its surfel in the cloud's columns.
/// \param fragment  what it makes of the pixel alone.
std::size_t PixelProbe::add_splat(const TileJob& job, std::uint32_t row, const Fragment& fragment) {
  const Splat& splat = *job.splats;
  const float* c = fragment.channel;
  ExplainedSplat& out = result_.splats.emplace_back();
  out.surfel = cloud_.place.empty() ? row : cloud_.place[row];
  out.exact = splat.k < 0;
  out.front = (splat.tag & kFrontTag) != 0;
  if (job.groups) out.group = *job.groups;
  out.weight = c[kWeight];
  out.depth = unlit_.z(c[kWeight] > 0 ? c[kDepth] / c[kWeight] : splat.depth);
  out.coefficient = out.exact ? job.exact->amplitude : splat.amplitude;
  const bool cut = job.clips && (splat.tag & kClippedTag) != 0 && c[kCutAway] > 0;
  if (cut) out.clip = out.weight / (out.weight + c[kCutAway] / job.clips->beyond);
  if (out.coefficient > 0) out.kernel = out.weight / (out.coefficient * out.clip);
  out.alpha = splat.alpha;
  out.color = straight(&splat.red, splat.alpha);
  out.fate = out.weight > 0 ? SplatFate::kUnused : SplatFate::kOutside;
  return result_.splats.size() - 1;
}

/// The depth behind which nothing of the pixel is seen.
float PixelProbe::hidden(const TileABuffer& state) const {
  return find_hidden(state)[static_cast<std::size_t>(pixel_)];
}

/// The least one of all pixels of the patch: splats behind it are left out.
float PixelProbe::least_hidden(const TileABuffer& state) const {
  const PixelDepths depths = find_hidden(state);
  const auto first = depths.begin() + (pixel_ - pixel_ % kPatchPixels);
  return *std::min_element(first, first + kPatchPixels);
}

/// A pixel's layers in use, as stored.
PixelProbe::Layers PixelProbe::layers_of(const TileABuffer& tile, int pixel) {
  Layers layers;
  for (int layer = 0; layer < tile.layout.layers; ++layer) {
    Fragment fragment;
    load_fragment(tile, layer, pixel, fragment);
    if (fragment.channel[kWeight] == 0) break;
    layers.push_back(fragment);
  }
  return layers;
}

/// Follows the tile's splats through the layers of the pixel, in the rasteriser's steps.
void PixelProbe::replay(const TileABuffer& tile, const TileJob& job, SplatLists& list, int worker) {
  Replay r{.job = job, .list = list, .worker = worker, .state = tile, .how = {}};
  state_.assign(tile.data, tile.data + tile.layout.size());
  r.state.data = state_.data();
  members_.resize(static_cast<std::size_t>(tile.layout.layers));
  // The tile, drawn as it is: it tells what is hidden where the next splats begin.
  Array<float> whole = state_;
  TileABuffer drawn = tile;
  drawn.data = whole.data();
  const auto patch = static_cast<std::size_t>(pixel_ / kPatchPixels);
  std::uint32_t next = job.sheets ? job.sheets_begin[patch] : 0;
  const std::uint32_t end_sheets = job.sheets ? job.sheets_begin[patch + 1] : 0;
  const auto take_sheets = [&](float depth) {
    for (; next < end_sheets && job.sheets[next].depth > depth; ++next) {
      replay_sheet(r, job.sheets[next]);
    }
  };
  for (std::size_t begin = 0; begin < job.count; begin += kHiddenEvery) {
    const std::size_t end = std::min(begin + kHiddenEvery, job.count);
    const std::uint32_t first_sheet = next;
    r.how.hidden = hidden(drawn);
    r.least_to_merge = least_to_merge(tile, job, begin, end);
    const std::vector<std::uint32_t> listed = listed_splats(job, begin, end, least_hidden(drawn));
    for (std::size_t i = 0; i < listed.size();) {
      const float depth = next < end_sheets ? job.sheets[next].depth : kNothingHidden;
      std::size_t last = i;
      while (last < listed.size() && job.splats[listed[last]].depth >= depth) ++last;
      for (; i < last; i += std::min(kOfferedTogether, last - i)) {
        replay_together(r, std::span(listed).subspan(i, std::min(kOfferedTogether, last - i)));
      }
      if (last < listed.size()) take_sheets(job.splats[listed[last]].depth);
    }
    draw_part(job, begin, end, first_sheet, next, drawn);
    std::copy_n(patch_of(drawn), tile.layout.patch_stride(), patch_of(r.state));
  }
  r.how.hidden = hidden(r.state);
  take_sheets(kNothingHidden);
}

/// rho of the least contribution that merges two surfaces, among splats [begin, end) of the order.
float PixelProbe::least_to_merge(const TileABuffer& tile, const TileJob& job, std::size_t begin,
                                 std::size_t end) {
  float largest = 0;
  for (std::size_t i = begin; i < end; ++i) {
    const Splat& splat = job.splats[job.order[i]];
    largest = std::max(largest, splat.k < 0 ? tile.full_weight : splat.amplitude);
  }
  return std::min(kMergingShare * tile.full_weight, kMergingShareOfLargest * largest);
}

/// The splats [begin, end) of the order that the rasteriser lists for the pixel's patch.
/// \param hidden  depth behind which nothing of the patch is seen.
std::vector<std::uint32_t> PixelProbe::listed_splats(const TileJob& job, std::size_t begin,
                                                     std::size_t end, float hidden) const {
  std::vector<std::uint32_t> listed;
  const float share = 1 + job.rules->depth_epsilon;
  for (std::size_t i = begin; i < end; ++i) {
    const Splat& splat = job.splats[job.order[i]];
    const float range = share * splat.depth_range;
    if (patch_in_box(job, splat.box) && range + splat.depth >= hidden) {
      listed.push_back(job.order[i]);
    }
  }
  return listed;
}

/// Draws the splats [begin, end) of the order onto a tile, with some sheets of the pixel's patch.
void PixelProbe::draw_part(const TileJob& job, std::size_t begin, std::size_t end,
                           std::uint32_t first_sheet, std::uint32_t end_sheet, TileABuffer& tile) {
  TileJob part = job;
  part.order = job.order + begin;
  part.count = end - begin;
  part.fragments = &fragments_;
  part.sheets = first_sheet < end_sheet ? job.sheets : nullptr;
  const auto patch = static_cast<std::size_t>(pixel_ / kPatchPixels);
  for (std::size_t i = 0; i < sheet_begin_.size(); ++i) {
    sheet_begin_[i] = i > patch ? end_sheet : first_sheet;
  }
  part.sheets_begin = sheet_begin_.data();
  rasterize_tile(part, tile);
}

/// A splat that meets the pixel, as an event of its own.
PixelProbe::Event PixelProbe::event_of(const TileABuffer& tile, const TileJob& job,
                                       std::uint32_t index) {
  Event event{.job = single(job, index), .members = {}, .fresh = {}, .depth = 0, .epsilon = 0};
  event.fresh = alone(tile, event.job);
  event.epsilon = epsilon_[static_cast<std::size_t>(pixel_)];
  if (event.rho() > 0) event.depth = front_depth(event.fresh);
  return event;
}

/// Offers splats to the layers, one after the other, and then puts those that no layer has taken
/// where there is no layer for them.
void PixelProbe::replay_together(Replay& r, std::span<const std::uint32_t> splats) {
  struct Waiting {
    std::uint32_t index;
    std::size_t place;
  };
  std::vector<Waiting> waiting;
  for (const std::uint32_t index : splats) {
    if (!in_box(r.job, r.job.splats[index].box)) continue;
    Event event = event_of(r.state, r.job, index);
    const std::size_t place = add_splat(event.job, r.list.surfel_of(index, r.worker), event.fresh);
    if (!(event.rho() > 0)) continue;
    event.members = {{place, event.fresh.channel[kAlpha]}};
    if (event.depth + event.epsilon < r.how.hidden) {
      result_.splats[place].fate = SplatFate::kHidden;
    } else if (!offer(r, event)) {
      waiting.push_back({index, place});
    }
  }
  bool made = false;  // Has one of them made a layer?
  for (const auto& [index, place] : waiting) {
    Event event = event_of(r.state, r.job, index);
    event.members = {{place, event.fresh.channel[kAlpha]}};
    if (made && offer(r, event)) continue;
    made = add_without_layer(r, event) || made;
  }
}

/// Offers an event to the layers. False if it waits: no layer has taken it, and none hides it.
bool PixelProbe::offer(Replay& r, Event& event) {
  const Layers before = layers_of(r.state, pixel_);
  const std::vector<float> patch = patch_copy(r.state);
  r.how.least_to_merge = kNowhere;
  r.how.epsilon = nullptr;
  event.job.replay = &r.how;
  rasterize_tile(event.job, r.state);
  if (settle(r, event, patch, before, {})) return true;
  const bool is_hidden = r.state.layout.opaque && !shows_front(event.fresh.channel[kTag]) &&
                         std::any_of(before.begin(), before.end(), [&](const Fragment& fragment) {
                           return !is_merged(fragment) && shows_front(fragment.channel[kTag]) &&
                                  covers(r.state, fragment) && front_depth(fragment) > event.depth;
                         });
  if (is_hidden) set_fate(event.members, SplatFate::kHidden);
  return is_hidden;
}

/// What the rasteriser does with a contribution that no layer has taken. Returns whether that has
/// made a layer.
bool PixelProbe::add_without_layer(Replay& r, const Event& event) {
  const Layers before = layers_of(r.state, pixel_);
  if (r.state.layout.layers == 1 && front_depth(before.front()) >= event.depth) {
    set_fate(event.members, SplatFate::kReplaced);
    return false;
  }
  if (event.rho() < r.least_to_merge) {
    set_fate(event.members, SplatFate::kTooLittle);
    return false;
  }
  const std::vector<float> patch = patch_copy(r.state);
  if (const std::optional<float> covering = depth_before(r.state, before, event.depth)) {
    const auto replace = [&](TileABuffer& tile, const Fragment& fresh) {
      replace_back(tile, pixel_, fresh, *covering);
    };
    if (r.state.layout.opaque) replace(r.state, event.fresh);
    if (settle(r, event, patch, before, replace)) return true;
    set_fate(event.members, SplatFate::kHidden);
    return false;
  }
  for (std::size_t layer = 0; layer < before.size(); ++layer) {
    const Fragment& fragment = before[layer];
    if (!is_merged(fragment)) continue;
    if (event.depth - event.epsilon < front_depth(fragment) &&
        event.depth + event.epsilon > fragment.channel[kBack]) {
      set_fate(event.members, SplatFate::kTooLate);
      if (!r.state.layout.opaque) return false;
      const auto add = [&](TileABuffer& tile, const Fragment& fresh) {
        add_to_merged_layer(tile, static_cast<int>(layer), pixel_, fresh);
      };
      add(r.state, event.fresh);
      settle(r, event, patch, before, add);
      return false;
    }
  }
  const auto insert = [&](TileABuffer& tile, const Fragment& fresh) {
    insert_by_merging(tile, pixel_, fresh, event.depth);
  };
  insert(r.state, event.fresh);
  settle(r, event, patch, before, insert);
  return true;
}

void PixelProbe::replay_sheet(Replay& r, const SheetPatch& sheet) {
  const NotedSheet& noted = r.list.sheet_of(sheet, r.worker);
  Event event{.job = {}, .members = {}, .fresh = {}, .depth = 0, .epsilon = 0};
  TileJob of_splats = r.job;
  of_splats.splats = noted.splats.data();
  of_splats.clips = nullptr;  // Splats that half-planes cut are in no sheet.
  std::vector<SplatNormal> normals(r.job.normals ? noted.splats.size() : 0);
  of_splats.normals = r.job.normals ? normals.data() : nullptr;
  for (std::size_t i = 0; i < noted.splats.size(); ++i) {
    if (!in_box(r.job, noted.splats[i].box)) continue;
    const TileJob one = single(of_splats, static_cast<std::uint32_t>(i));
    const Fragment fragment = alone(r.state, one);
    const std::size_t place = add_splat(one, noted.surfels[i], fragment);
    result_.splats[place].in_sheet = true;
    if (fragment.channel[kWeight] > 0) event.members.push_back({place, fragment.channel[kAlpha]});
  }
  event.job = single_sheet(r.job, sheet, r.state.layout.normals);
  event.fresh = alone(r.state, event.job);
  if (!(event.rho() > 0)) return;
  event.depth = front_depth(event.fresh);
  const Layers before = layers_of(r.state, pixel_);
  const std::vector<float> patch = patch_copy(r.state);
  r.least_to_merge = kMergingShare * r.state.full_weight;
  r.how.least_to_merge = r.least_to_merge;
  r.how.epsilon = nullptr;
  event.job.replay = &r.how;
  rasterize_tile(event.job, r.state);
  const auto again = [&](TileABuffer& tile, const Fragment& fresh) {
    for (const FragmentChannel c : kColorChannels) {
      std::fill_n(sheet_sums_.begin() + c * kPatchPixels, kPatchPixels, fresh.channel[c]);
    }
    rasterize_tile(event.job, tile);
  };
  if (!settle(r, event, patch, before, again)) {
    set_fate(event.members, why_dropped(r, before, event));
  }
}

SplatFate PixelProbe::why_dropped(const Replay& r, const Layers& layers, const Event& event) {
  if (depth_before(r.state, layers, event.depth)) return SplatFate::kHidden;
  if (r.state.layout.layers == 1) return SplatFate::kReplaced;
  return event.rho() < r.least_to_merge ? SplatFate::kTooLittle : SplatFate::kTooLate;
}

void PixelProbe::set_fate(const std::vector<Member>& members, SplatFate fate) {
  for (const Member& member : members) result_.splats[member.splat].fate = fate;
}

std::vector<float> PixelProbe::patch_copy(const TileABuffer& tile) const {
  const float* const patch = patch_of(tile);
  return {patch, patch + tile.layout.patch_stride()};
}

/// Notes where an event went that has been added to the pixel. False if it went nowhere.
/// \param patch, before  the pixel's patch and layers before it.
/// \param again  adds it to a tile, with the colours of another fragment.
bool PixelProbe::settle(Replay& r, const Event& event, std::span<const float> patch, Layers before,
                        const AddAgain& again) {
  const Layers after = layers_of(r.state, pixel_);
  before.resize(after.size(), Fragment{});
  std::vector<int> changed;
  for (std::size_t i = 0; i < after.size(); ++i) {
    if (!std::equal(std::begin(before[i].channel), std::end(before[i].channel),
                    std::begin(after[i].channel))) {
      changed.push_back(static_cast<int>(i));
    }
  }
  if (changed.empty()) return false;
  set_fate(event.members, SplatFate::kBlended);
  const auto members_at = [&](int layer) -> std::vector<Member>& {
    return members_[static_cast<std::size_t>(layer)];
  };
  const auto append = [](std::vector<Member>& to, const std::vector<Member>& from, double factor) {
    for (const Member& member : from) to.push_back({member.splat, member.part * factor});
  };
  if (changed.size() == 2) {
    // Two layers have become one, and the event has taken the other's place.
    const auto weight_at = [&](int k) {
      return after[static_cast<std::size_t>(changed[static_cast<std::size_t>(k)])].channel[kWeight];
    };
    const bool summed = weight_at(0) > 0 && weight_at(1) > 0;
    const bool swapped = summed ? weight_at(0) == event.rho() : weight_at(1) < 0;
    const int into = changed[swapped ? 1 : 0];
    const int freed = changed[swapped ? 0 : 1];
    std::array<double, 3> parts{1, 1, 1};
    if (!summed) parts = parts_of(r, event, patch, again, into, freed);
    std::vector<Member> merged;
    append(merged, members_at(into), parts[0]);
    append(merged, members_at(freed), parts[1]);
    members_at(into) = std::move(merged);
    members_at(freed) = event.members;
    return true;
  }
  const int layer = changed.front();
  const float* was = before[static_cast<std::size_t>(layer)].channel;
  const float* is = after[static_cast<std::size_t>(layer)].channel;
  if (is[kWeight] > 0) {
    const float sum = was[kWeight] + event.rho();
    if (std::abs(is[kWeight] - sum) > 1e-5F * sum) {
      set_fate(members_at(layer), SplatFate::kReplaced);
      members_at(layer).clear();
    }
    append(members_at(layer), event.members, 1);
    return true;
  }
  const bool late =
      was[kWeight] == is[kWeight] && was[kDepth] == is[kDepth] && was[kBack] == is[kBack];
  if (late) set_fate(event.members, SplatFate::kFilledUp);
  const std::array<double, 3> parts = parts_of(r, event, patch, again, layer, -1);
  for (Member& member : members_at(layer)) member.part *= parts[0];
  append(members_at(layer), event.members, parts[2]);
  return true;
}

/// Adds an event once more to the pixel as it was before, with a unit of red in one layer, of green
/// in a second and of blue in the event: the first layer, which is merged then, has so much of
/// each.
std::array<double, 3> PixelProbe::parts_of(const Replay& r, const Event& event,
                                           std::span<const float> patch, const AddAgain& again,
                                           int first, int second) {
  const std::vector<float> after = patch_copy(r.state);
  std::copy(patch.begin(), patch.end(), patch_of(r.state));
  TileABuffer units = r.state;
  units.shader = &unlit_;
  for (int layer = 0; layer < units.layout.layers; ++layer) {
    for (const FragmentChannel c : kColorChannels) units.at(layer, c, pixel_) = 0;
  }
  units.at(first, kRed, pixel_) = 1;
  if (second >= 0) units.at(second, kGreen, pixel_) = 1;
  Fragment fresh = event.fresh;
  fresh.channel[kRed] = fresh.channel[kGreen] = 0;
  fresh.channel[kBlue] = 1;
  again(units, fresh);
  Fragment merged;
  load_fragment(units, first, pixel_, merged);
  std::copy(after.begin(), after.end(), patch_of(r.state));
  return {merged.channel[kRed], merged.channel[kGreen], merged.channel[kBlue]};
}

/// Composites the pixel again and again, with units of colour in three splats each time.
void PixelProbe::respond(const TileABuffer& tile, std::span<const TileJob> jobs,
                         std::span<SplatLists> lists, int worker, Compositor::Worker& compositor) {
  struct Subset {
    std::vector<Splat> splats;
    std::vector<SplatNormal> normals;
    std::vector<ExactSplat> exact;
    std::vector<SplatClip> clips;
    std::vector<std::uint16_t> groups;
    std::vector<std::uint32_t> order;
  };
  std::vector<Subset> subsets(jobs.size());
  std::vector<TileJob> reduced(jobs.begin(), jobs.end());
  std::vector<Splat*> colored;
  for (std::size_t j = 0; j < jobs.size(); ++j) {
    Subset& subset = subsets[j];
    for (std::size_t i = 0; i < jobs[j].count; ++i) {
      const std::uint32_t index = jobs[j].order[i];
      if (!in_box(jobs[j], jobs[j].splats[index].box)) continue;
      const TileJob one = single(jobs[j], index);
      add_splat(one, lists[j].surfel_of(index, worker), alone(tile, one));
      subset.splats.push_back(one_.splat);
      subset.normals.push_back(one_.normal);
      subset.exact.push_back(one_.exact);
      subset.clips.push_back(one_.clip);
      if (jobs[j].groups) subset.groups.push_back(*one.groups);
    }
    const std::size_t count = subset.splats.size();
    subset.order.assign(count + kTileSize, 0);
    std::iota(subset.order.begin(), subset.order.begin() + static_cast<std::ptrdiff_t>(count), 0U);
    TileJob& job = reduced[j];
    job.splats = subset.splats.data();
    job.normals = job.normals ? subset.normals.data() : nullptr;
    job.exact = subset.exact.data();
    job.clips = job.clips ? subset.clips.data() : nullptr;
    job.groups = job.groups ? subset.groups.data() : nullptr;
    job.order = subset.order.data();
    job.count = count;
    job.fragments = &fragments_;
    for (Splat& splat : subset.splats) {
      splat.red = splat.green = splat.blue = 0;
      colored.push_back(&splat);
    }
  }
  TileABuffer scratch = tile;
  scratch.shader = &unlit_;
  constexpr std::array<float Splat::*, 3> kColors{&Splat::red, &Splat::green, &Splat::blue};
  for (std::size_t first = 0; first < colored.size(); first += kColors.size()) {
    const std::size_t count = std::min(kColors.size(), colored.size() - first);
    for (std::size_t i = 0; i < count; ++i)
      colored[first + i]->*kColors[i] = colored[first + i]->alpha;
    // Methods that shade splats keep their colours as long as the number stays.
    for (TileJob& job : reduced) job.load = ~std::uint64_t{0} - first;
    state_.assign(tile.layout.size(), 0.0F);
    scratch.data = state_.data();
    compositor.draw(reduced, scratch);
    Response& response = responses_.emplace_back();
    response.patch.assign(patch_of(scratch), patch_of(scratch) + tile.layout.patch_stride());
    response.behind = compositor.behind(pixel_);
    for (std::size_t i = 0; i < count; ++i) colored[first + i]->*kColors[i] = 0;
  }
}

/// The pixel's colour, unlit and over nothing, with other fragments than it has.
Rgba PixelProbe::resolved(std::span<const float> patch, const Fragment& behind,
                          const TileRims& rims) {
  state_ = kept_;
  TileABuffer tile = kept_tile_;
  tile.data = state_.data();
  tile.shader = &unlit_;
  // The pixels around keep their sums, which tell what the pixel's surfaces cover.
  float* const to = patch_of(tile);
  for (std::size_t i = static_cast<std::size_t>(pixel_) % kPatchPixels; i < patch.size();
       i += kPatchPixels) {
    to[i] = patch[i];
  }
  if (plain_) {
    // A back that covers the pixel is no far side here.
    const PlainPixels plain = resolve_plain_pixels(tile, nullptr, {});
    const std::uint32_t lone = plain.lone[static_cast<std::size_t>(pixel_) / kPatchPixels];
    const bool waits = (lone >> (pixel_ % kPatchPixels) & 1U) != 0;
    const auto place = static_cast<std::size_t>(pixel_);
    if (plain.left[place] == 0 && !waits) return plain.color[place];
  }
  OpenPixels open;
  const std::optional<PixelResult> result = resolve_pixel(tile, pixel_, behind, false, open);
  if (result) return result->color;
  return resolve_open_pixel(tile, open, open.pixels.front(), rims).color;
}

void PixelProbe::resolve(const TileRims& rims, const Shader& shader) {
  kept_tile_.data = kept_.data();
  if (replays_) {
    resolve_layers(rims, shader);
    return;
  }
  for (std::size_t i = 0; i < responses_.size(); ++i) {
    const Rgba color = resolved(responses_[i].patch, responses_[i].behind, rims);
    const std::array<float, 3> shares{color.red, color.green, color.blue};
    for (std::size_t c = 0; c < shares.size() && 3 * i + c < result_.splats.size(); ++c) {
      ExplainedSplat& splat = result_.splats[3 * i + c];
      splat.share = shares[c];
      if (splat.share > 0) splat.fate = SplatFate::kBlended;
    }
  }
}

void PixelProbe::resolve_layers(const TileRims& rims, const Shader& shader) {
  const Layers layers = layers_of(kept_tile_, pixel_);
  members_.resize(std::max(members_.size(), layers.size()));
  std::vector<int> order(layers.size());
  std::iota(order.begin(), order.end(), 0);
  std::stable_sort(order.begin(), order.end(), [&](int a, int b) {
    return front_depth(layers[static_cast<std::size_t>(a)]) >
           front_depth(layers[static_cast<std::size_t>(b)]);
  });
  std::vector<float> patch(kept_tile_.layout.patch_stride());
  for (std::size_t place = 0; place < order.size(); ++place) {
    const int stored = order[place];
    const Fragment& fragment = layers[static_cast<std::size_t>(stored)];
    const float* c = fragment.channel;
    TileABuffer units = kept_tile_;
    Array<float> whole = kept_;
    units.data = whole.data();
    for (int layer = 0; layer < units.layout.layers; ++layer) {
      for (const FragmentChannel channel : kColorChannels) units.at(layer, channel, pixel_) = 0;
    }
    units.at(stored, kRed, pixel_) = 1;
    std::copy_n(patch_of(units), patch.size(), patch.begin());
    const double response = resolved(patch, {}, rims).red;
    ExplainedLayer& out = result_.layers.emplace_back();
    out.depth = unlit_.z(front_depth(fragment));
    out.merged = is_merged(fragment);
    out.front = shows_front(c[kTag]);
    out.weight = out.merged ? 0 : c[kWeight];
    out.share = response * c[kAlpha];
    out.color = straight(c + kRed, c[kAlpha]);
    if (!out.merged && shader.lit()) {
      const Rgba shaded = shader.shade(fragment, static_cast<float>(x()) + 0.5F,
                                       static_cast<float>(y()) + 0.5F, kept_tile_.full_weight);
      out.color = straight(&shaded.red, shaded.alpha);
    }
    const std::vector<Member>& members = members_[static_cast<std::size_t>(stored)];
    out.splats = members.size();
    for (const Member& member : members) {
      result_.splats[member.splat].layer = static_cast<int>(place);
      result_.splats[member.splat].share = response * member.part;
    }
  }
}

PixelExplanation PixelProbe::finish(const Rgba& background, bool lit, bool environment) {
  const auto& [first, edged, last] = stages_;
  const auto sum = [](const std::array<float, 4>& color) {
    return static_cast<double>(color[0]) + color[1] + color[2];
  };
  PixelExplanation& out = result_;
  out.splats_add_up = !lit && !environment;
  if (!replays_ && first[3] > 0) {
    ExplainedLayer& all = out.layers.emplace_back();
    double depths = 0;
    for (const ExplainedSplat& splat : out.splats) {
      if (!(splat.share > 0)) continue;
      ++all.splats;
      all.share += splat.share;
      depths += splat.share * splat.depth;
    }
    if (all.share > 0) all.depth = depths / all.share;
    all.share = first[3];
    all.color = straight(first.data(), first[3]);
  }
  out.filled = first[3] == 0 && edged[3] > 0;
  if (first[3] > 0 && !environment) out.edge = static_cast<double>(edged[3]) / first[3];
  if (sum(edged) > 0) out.relief = sum(last) / sum(edged);
  out.surfaces = Vec3f(last[0], last[1], last[2]);
  out.alpha = last[3];
  for (ExplainedSplat& splat : out.splats) splat.share *= out.edge;
  if (environment) out.environment = out.surfaces;
  for (ExplainedLayer& layer : out.layers) {
    layer.share *= out.edge;
    if (environment && replays_) {
      out.environment -= static_cast<float>(out.relief * layer.share) * layer.color;
    }
  }
  if (environment && !replays_) out.environment = {0, 0, 0};
  out.background = {background.red, background.green, background.blue, background.alpha};
  for (std::size_t c = 0; c < 4; ++c) {
    out.pixel[c] = last[c] + (1 - last[3]) * out.background[c];
  }
  return std::move(out);
}

}  // namespace surfel
