#include <algorithm>
#include <atomic>
#include <cstring>
#include <functional>
#include <optional>
#include <span>

#include <fmt/format.h>
#include <surfel/base/error.h>
#include <surfel/base/memory.h>
#include <surfel/base/parallel.h>
#include <surfel/base/progress.h>
#include <surfel/io/cloud_from_records.h>
#include <surfel/io/surfel_decoder.h>

namespace surfel {
namespace {

using enum SurfelAttribute;

/// Records that one thread takes at a time.
constexpr std::size_t kReadBlock = 16 * SurfelDecoder::kPiece;

/// More points than any memory holds, so that their bytes can be counted.
constexpr std::uint64_t kManyPoints = std::uint64_t{1} << 40;

/// Is a header's box as good as the points' own to place an origin by?
bool about_the_same(const Bounds& said, const Bounds& box) {
  if (box.empty()) return false;
  const double tolerance = 0.01 * box.diagonal();
  return ((said.min - box.min).array().abs() <= tolerance).all() &&
         ((said.max - box.max).array().abs() <= tolerance).all();
}

Vec3d origin_for(const Bounds& box, bool stepped) {
  return stepped ? central_origin(box) : float_origin(box);
}

class Reader {
 public:
  /// \param decoder  of a table with the same columns
  Reader(const RecordTable& table, const SurfelDecoder& decoder, const std::string& file)
      : table_(table),
        file_(file),
        decoder_(decoder),
        available_(available_memory_for(std::min<std::uint64_t>(table.count, kManyPoints) *
                                        table.columns.size() * sizeof(double))) {}

  /// Places the points by their own bounds.
  SurfelCloud read(bool double_positions);
  SurfelCloud read(bool double_positions, const PointPlace& place);
  Array<Vec3f> positions(const PointPlace& place);
  /// Measures the points without keeping them.
  PointPlace measure();

 private:
  /// Of each piece of the table.
  struct Measures {
    std::vector<Bounds> boxes;  ///< Where coordinates are floats.
    std::vector<int> decimals;  ///< Empty where they are not counted.
    /// Unset where coordinates are floats, which are exact about an origin for the whole box.
    std::optional<CoordinateSpread> spread;

    Bounds box() const {
      if (spread) return spread->box();
      Bounds all;
      for (const Bounds& part : boxes) {
        all.min = all.min.cwiseMin(part.min);
        all.max = all.max.cwiseMax(part.max);
      }
      return all;
    }
    /// What the origin should suit.
    Bounds core() const { return spread ? spread->core(box()) : box(); }
  };
  /// Decodes `count` records in memory, the first of which is surfel `begin`.
  using Column =
      std::function<void(const std::byte* records, std::size_t begin, std::size_t count)>;

  template <class T>
  void allocate(Array<T>& to, std::size_t values);
  template <class T>
  void add_scalar(SurfelAttribute attribute, Array<T>& to);
  template <int kSize>
  void add_vector(SurfelAttribute attribute, Array<Eigen::Matrix<float, kSize, 1>>& to);
  void add_columns();
  void add_exact();
  bool counts_decimals() const { return table_.step == 0 && decoder_.double_positions(); }
  PointPlace place_of(const Measures& measures) const;
  bool needs_exact(const PointPlace& place) const;
  void pass(std::span<const Column> columns, Measures* measures);
  SurfelCloud finished(bool double_positions, const PointPlace& place);

  const RecordTable& table_;
  const std::string& file_;
  SurfelDecoder decoder_;
  std::vector<Column> columns_;
  std::uint64_t allocated_ = 0;
  const std::uint64_t available_;
  SurfelCloud cloud_;
};

template <class T>
void Reader::allocate(Array<T>& to, std::size_t values) {
  allocated_ += std::uint64_t{values} * sizeof(T);
  if (allocated_ > available_) {
    throw_input(file_, fmt::format("{} points need more than the {} MB of memory that are free",
                                   table_.count, available_ >> 20));
  }
  to.resize(values);
}

template <class T>
void Reader::add_scalar(SurfelAttribute attribute, Array<T>& to) {
  if (!decoder_.has(attribute)) return;
  allocate(to, table_.count);
  columns_.emplace_back([this, attribute, first = to.data()](const std::byte* records,
                                                             std::size_t begin, std::size_t count) {
    decoder_.decode<T>(attribute, records, count, {{first + begin}, 1});
  });
}

template <int kSize>
void Reader::add_vector(SurfelAttribute attribute, Array<Eigen::Matrix<float, kSize, 1>>& to) {
  if (!decoder_.has(attribute)) return;
  allocate(to, table_.count);
  columns_.emplace_back([this, attribute, first = to.data()](const std::byte* records,
                                                             std::size_t begin, std::size_t count) {
    float* at = first[begin].data();
    decoder_.decode<float>(attribute, records, count, {{at, at + 1, at + 2}, kSize});
  });
}

void Reader::add_columns() {
  add_vector<3>(kPosition, cloud_.position);
  add_vector<3>(kNormal, cloud_.normal);
  add_vector<3>(kShadingNormal, cloud_.shading_normal);
  add_vector<3>(kTangent, cloud_.tangent);
  add_scalar(kVarianceU, cloud_.variance_u);
  add_scalar(kVarianceV, cloud_.variance_v);
  add_scalar(kVariance, cloud_.variance);
  add_scalar(kArea, cloud_.area);
  add_vector<3>(kClip1, cloud_.clip1);
  add_scalar(kClip1Distance, cloud_.clip1_distance);
  add_vector<3>(kClip2, cloud_.clip2);
  add_scalar(kClip2Distance, cloud_.clip2_distance);
  add_vector<3>(kColor, cloud_.color);
  add_scalar(kAlpha, cloud_.alpha);
  add_vector<3>(kCoefficient, cloud_.coefficient);
  add_vector<2>(kUv, cloud_.uv);
  add_vector<3>(kDpdu, cloud_.dpdu);
  add_vector<3>(kDpdv, cloud_.dpdv);
  add_scalar(kMaterial, cloud_.material);
  add_scalar(kGroup, cloud_.group);
  add_scalar(kGroupRadius, cloud_.group_radius);
  add_scalar(kSource, cloud_.source);
  add_scalar(kLevel, cloud_.level);
  for (const RecordColumn* column : decoder_.others()) {
    ExtraProperty& extra = cloud_.extra.emplace_back(ExtraProperty{column->name, column->type, {}});
    const std::size_t size = scalar_size(column->type);
    allocate(extra.data, table_.count * size);
    columns_.emplace_back([this, column, size, first = extra.data.data()](
                              const std::byte* records, std::size_t begin, std::size_t count) {
      decoder_.decode(*column, records, count, first + begin * size);
    });
  }
}

void Reader::add_exact() {
  allocate(cloud_.exact, table_.count);
  columns_.emplace_back([this](const std::byte* records, std::size_t begin, std::size_t count) {
    decoder_.decode_exact(records, count, cloud_.exact.data() + begin);
  });
}

/// Are there coordinates that offsets from the origin do not tell to the last bit?
bool Reader::needs_exact(const PointPlace& place) const {
  if (!decoder_.double_positions()) return false;
  const double step = place.decimals ? 1 / power_of_ten(*place.decimals) : table_.step;
  if (step > 0) return !tells_apart(place.bounds, place.origin, step);
  std::atomic<bool> exact = true;
  table_.for_pieces(kReadBlock, [&](std::size_t, std::size_t begin, std::size_t end,
                                    const std::byte* records, int) {
    if (exact && !decoder_.offsets_are_exact(records, end - begin, place.origin)) exact = false;
  });
  return !exact;
}

PointPlace Reader::place_of(const Measures& measures) const {
  const Bounds box = measures.box();
  require_float_extent(box, file_);
  const Bounds core = measures.core();
  if (core.diagonal() == box.diagonal() && table_.said_bounds && !counts_decimals() &&
      about_the_same(*table_.said_bounds, box)) {
    PointPlace place{box, origin_for(*table_.said_bounds, table_.step > 0), {}};
    place.exact = needs_exact(place);
    return place;
  }
  const std::vector<int>& decimals = measures.decimals;
  std::optional<int> most;
  if (!decimals.empty()) most = *std::max_element(decimals.begin(), decimals.end());
  PointPlace place = place_points(core, table_.step > 0, most);
  place.bounds = box;
  place.exact = needs_exact(place);
  return place;
}

/// Fills columns and measures the points.
/// \param measures  null where they are known
void Reader::pass(std::span<const Column> columns, Measures* measures) {
  if (measures) {
    measures->boxes.assign(table_.pieces(kReadBlock), {});
    measures->decimals.assign(counts_decimals() ? measures->boxes.size() : 0, 0);
  }
  // What is read range by range is part of a longer stage.
  std::optional<ProgressStage> stage;
  if (measures) stage.emplace("reading " + file_, table_.count, "points");
  PerWorker<CoordinateSpread> spreads;
  const bool doubles = decoder_.double_positions();
  table_.for_pieces(kReadBlock, [&](std::size_t piece, std::size_t begin, std::size_t end,
                                    const std::byte* records, int worker) {
    for (std::size_t i = begin; i < end; i += SurfelDecoder::kPiece) {
      const std::size_t count = std::min(SurfelDecoder::kPiece, end - i);
      if (measures) {
        if (doubles) {
          decoder_.measure(records, count, spreads[worker]);
        } else {
          decoder_.measure(records, count, measures->boxes[piece]);
        }
        if (!measures->decimals.empty()) {
          decoder_.count_decimals(records, count, measures->decimals[piece]);
        }
      }
      for (const Column& column : columns) column(records, i, count);
      records += count * table_.stride;
    }
    if (stage) stage->add(end - begin);
  });
  spreads.for_each([&](const CoordinateSpread& part) {
    if (!measures->spread) measures->spread.emplace();
    measures->spread->add(part);
  });
}

SurfelCloud Reader::finished(bool double_positions, const PointPlace& place) {
  cloud_.double_positions = double_positions;
  cloud_.color_encoding = decoder_.color_encoding();
  cloud_.alpha_as_uint8 = decoder_.alpha_as_uint8();
  cloud_.origin = place.origin;
  cloud_.decimals = place.decimals;
  return std::move(cloud_);
}

/// Fills the columns, then the positions again if they lie so far from the origin that was assumed
/// that it must move.
SurfelCloud Reader::read(bool double_positions) {
  add_columns();
  PointPlace place;
  if (table_.said_bounds) place.origin = origin_for(*table_.said_bounds, table_.step > 0);
  decoder_.set_origin(place.origin);
  Measures measures;
  pass(columns_, &measures);
  const Vec3d assumed = place.origin;
  place = place_of(measures);
  decoder_.set_origin(place.origin);
  if (place.origin != assumed) pass(std::span(columns_).first(1), nullptr);
  if (place.exact) {
    add_exact();
    pass(std::span(columns_).last(1), nullptr);
  }
  return finished(double_positions, place);
}

SurfelCloud Reader::read(bool double_positions, const PointPlace& place) {
  add_columns();
  if (place.exact) add_exact();
  decoder_.set_origin(place.origin);
  pass(columns_, nullptr);
  return finished(double_positions, place);
}

Array<Vec3f> Reader::positions(const PointPlace& place) {
  add_vector<3>(kPosition, cloud_.position);
  decoder_.set_origin(place.origin);
  pass(columns_, nullptr);
  return std::move(cloud_.position);
}

PointPlace Reader::measure() {
  Measures measures;
  pass({}, &measures);
  return place_of(measures);
}

}  // namespace

PointPlace place_points(const Bounds& bounds, bool stepped, const std::optional<int>& decimals) {
  PointPlace place{bounds, origin_for(bounds, stepped), {}};
  if (!decimals || *decimals >= kManyDecimals) return place;
  place.decimals = decimals;
  // An origin from which offsets tell coordinates of so many decimals apart, if there is one.
  for (const Vec3d& origin : {place.origin, central_origin(bounds)}) {
    if (!tells_apart(bounds, origin, 1 / power_of_ten(*decimals))) continue;
    place.origin = origin;
    break;
  }
  return place;
}

SurfelCloud cloud_from_records(const RecordTable& table, const std::string& file,
                               bool double_positions) {
  return Reader(table, SurfelDecoder(table, file), file).read(double_positions);
}

SurfelCloud PointRecords::read_all() const {
  SurfelCloud cloud = cloud_from_records(table(), file(), double_positions());
  describe(cloud);
  return cloud;
}

struct PieceReader::Impl {
  const PointRecords& points;
  SurfelDecoder decoder;

  explicit Impl(const PointRecords& of) : points(of), decoder(of.table(), of.file()) {}
};

PieceReader::PieceReader(const PointRecords& points) : impl_(std::make_unique<Impl>(points)) {}
PieceReader::~PieceReader() = default;

std::size_t PieceReader::parts() const { return impl_->points.table().pieces(kReadBlock); }

std::size_t PieceReader::first(std::size_t part) const {
  const RecordTable& table = impl_->points.table();
  return table.blocks ? table.blocks->first(part) : std::min(part * kReadBlock, table.count);
}

PointPlace PieceReader::measure() const {
  const PointRecords& points = impl_->points;
  return Reader(points.table(), impl_->decoder, points.file()).measure();
}

SurfelCloud PieceReader::read(std::size_t begin, std::size_t end, const PointPlace* place) const {
  RecordTable part = impl_->points.table();
  Array<std::byte> records;
  part.said_bounds.reset();
  if (part.blocks) {
    part.count = first(end) - first(begin);
    // Made once, as the records are read twice where the origin has to move.
    records.resize(part.count * part.stride);
    parallel_for(end - begin, 1, [&](std::size_t k, std::size_t, int) {
      static thread_local Array<std::byte> scratch;
      const std::size_t from = first(begin + k);
      const std::size_t bytes = (first(begin + k + 1) - from) * part.stride;
      if (bytes == 0) return;
      std::memcpy(records.data() + (from - first(begin)) * part.stride,
                  part.blocks->read(begin + k, scratch), bytes);
    });
    part.blocks = nullptr;
    part.data = records.data();
  } else {
    part.skip(first(begin));
    part.count = first(end) - first(begin);
  }
  Reader reader(part, impl_->decoder, impl_->points.file());
  const bool double_positions = impl_->points.double_positions();
  SurfelCloud piece = place ? reader.read(double_positions, *place) : reader.read(double_positions);
  impl_->points.describe(piece);
  return piece;
}

struct RangeReader::Impl {
  const PointRecords& points;
  SurfelDecoder decoder;
  PointPlace place;

  explicit Impl(const PointRecords& of)
      : points(of),
        decoder(of.table(), of.file()),
        place(Reader(of.table(), decoder, of.file()).measure()) {}

  RecordTable part(std::size_t begin, std::size_t end) const {
    RecordTable out = points.table();
    out.skip(begin);
    out.count = end - begin;
    return out;
  }
};

RangeReader::RangeReader(const PointRecords& points) : impl_(std::make_unique<Impl>(points)) {}
RangeReader::~RangeReader() = default;

const PointPlace& RangeReader::place() const { return impl_->place; }

SurfelCloud RangeReader::read(std::size_t begin, std::size_t end) const {
  const PointRecords& points = impl_->points;
  const RecordTable part = impl_->part(begin, end);
  SurfelCloud range =
      Reader(part, impl_->decoder, points.file()).read(points.double_positions(), impl_->place);
  points.describe(range);
  return range;
}

Array<Vec3f> RangeReader::positions(std::size_t begin, std::size_t end) const {
  const RecordTable part = impl_->part(begin, end);
  return Reader(part, impl_->decoder, impl_->points.file()).positions(impl_->place);
}

}  // namespace surfel
