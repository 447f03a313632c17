#pragma once

#include <array>
#include <cstddef>
#include <functional>
#include <string>
#include <vector>

#include <surfel/io/record_table.h>
#include <surfel/scene/surfel_cloud.h>

namespace surfel {

/// Which columns a file gets.
struct CloudRecordOptions {
  /// PCL's names for normals, and 8-bit colours packed into one float `rgb`, as PCL's own point
  /// types have them.
  bool pcl_names = false;
  /// Coordinates are stored as double even if float would be exact.
  bool double_positions = false;
  /// Coordinates of a cloud whose origin is not zero are stored as double even if float would be
  /// exact: the shortest decimal of a float means the number of the file only after rounding to
  /// float.
  bool for_text = false;
};

/// Have records the same columns, so that they may stand in one file?
bool same_columns(const std::vector<RecordColumn>& a, const std::vector<RecordColumn>& b);

/// A cloud's columns as a file's records, made range by range. Internal to the library.
class CloudRecords {
 public:
  /// Keeps a reference to the cloud.
  CloudRecords(const SurfelCloud& cloud, const CloudRecordOptions& options);
  CloudRecords(SurfelCloud&& cloud, const CloudRecordOptions& options) = delete;

  const std::vector<RecordColumn>& columns() const { return columns_; }
  std::size_t stride() const { return stride_; }
  /// Writes the records [begin, end) in this machine's byte order. Callable from any thread.
  void encode(std::size_t begin, std::size_t end, std::byte* out) const;

 private:
  template <class T, class Value>
  void add(const std::string& name, Value value);
  template <class T>
  void add_scalar(const char* name, const Array<T>& column);
  template <int kSize>
  void add_vector(const char* const (&names)[kSize],
                  const Array<Eigen::Matrix<float, kSize, 1>>& column);
  void add_position(const CloudRecordOptions& options);
  void add_variances();
  void add_color(bool pcl_names);
  void add_alpha();
  void add_extra(const ExtraProperty& property);

  const SurfelCloud& cloud_;
  std::vector<RecordColumn> columns_;
  std::size_t stride_ = 0;
  /// For each column, a function that fills it in the records [begin, end), which start at `out`.
  std::vector<std::function<void(std::size_t begin, std::size_t end, std::byte* out)>> encode_;
};

/// Reads the coordinates back from records that CloudRecords has made.
class RecordPositions {
 public:
  explicit RecordPositions(const CloudRecords& records);

  /// Of the i-th of some records, in world coordinates.
  Vec3d operator()(const std::byte* records, std::size_t i) const;

 private:
  std::size_t stride_;
  std::array<std::size_t, 3> offset_{};
  bool doubles_ = false;
};

}  // namespace surfel
