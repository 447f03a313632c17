#pragma once

#include <cstddef>
#include <memory>
#include <optional>
#include <string>

#include <surfel/base/bounds.h>
#include <surfel/io/record_table.h>
#include <surfel/scene/surfel_cloud.h>

namespace surfel {

/// The surfels in a file's records, as SurfelDecoder decodes them; properties that stand for no
/// attribute go to `extra`. Positions are re-centred, see cloud_io.h.
/// \param file              Name for messages.
/// \param double_positions  The file declares its coordinates as double (text may be read as double
///                          in spite of its header).
///
/// Throws Error(kInput) where there are no records, a coordinate is missing or the memory does not
/// suffice. Internal to the io module.
SurfelCloud cloud_from_records(const RecordTable& table, const std::string& file,
                               bool double_positions);

/// A file's points as records, and what the file says of all of them. Internal to the io module.
class PointRecords {
 public:
  virtual ~PointRecords() = default;
  /// Stays as it is.
  virtual const RecordTable& table() const = 0;
  virtual const std::string& file() const = 0;
  virtual bool double_positions() const = 0;
  /// Sets what holds for all points of the file in a cloud of all or some of its points.
  virtual void describe(SurfelCloud& cloud) const = 0;

  /// All points.
  SurfelCloud read_all() const;
};

/// Where all points of a file lie: what it needs all coordinates to know.
struct PointPlace {
  Bounds bounds;                ///< Of the finite positions, world coordinates.
  Vec3d origin{0, 0, 0};        ///< SurfelCloud::origin.
  std::optional<int> decimals;  ///< SurfelCloud::decimals.
  bool exact = false;           ///< The clouds have SurfelCloud::exact.
};

/// Where points are placed whose bounds are known, one at least.
/// \param stepped   Are the coordinates multiples of a step?
/// \param decimals  the most decimals of the coordinates where they are doubles; else unset.
PointPlace place_points(const Bounds& bounds, bool stepped, const std::optional<int>& decimals);

/// Points of a file piece by piece. The columns are the same for all pieces. Keeps a reference to
/// the points. Internal to the io module.
class PieceReader {
 public:
  explicit PieceReader(const PointRecords& points);
  ~PieceReader();
  PieceReader(const PieceReader&) = delete;
  PieceReader& operator=(const PieceReader&) = delete;

  /// How many parts the file has, of some thousand points each, which can be read together.
  std::size_t parts() const;
  std::size_t first(std::size_t part) const;  ///< Points before a part; of part parts() all.
  /// The points of some parts.
  /// \param place  null: they get an origin of their own.
  SurfelCloud read(std::size_t begin, std::size_t end, const PointPlace* place = nullptr) const;
  /// Where PointRecords::read_all() places the points; reads all coordinates.
  PointPlace measure() const;

 private:
  struct Impl;
  std::unique_ptr<Impl> impl_;
};

/// Any ranges of a file's points, of records that are not in blocks, with the values that
/// PointRecords::read_all() gives them. Keeps a reference to the points. Internal to the io module.
class RangeReader {
 public:
  /// Reads all coordinates once to place the points.
  explicit RangeReader(const PointRecords& points);
  ~RangeReader();
  RangeReader(const RangeReader&) = delete;
  RangeReader& operator=(const RangeReader&) = delete;

  const PointPlace& place() const;
  /// The points [begin, end). Callable from any thread.
  SurfelCloud read(std::size_t begin, std::size_t end) const;
  /// Their positions alone.
  Array<Vec3f> positions(std::size_t begin, std::size_t end) const;

 private:
  struct Impl;
  std::unique_ptr<Impl> impl_;
};

}  // namespace surfel
