#pragma once

#include <array>
#include <cstddef>
#include <memory>
#include <optional>
#include <string>

#include <surfel/io/input_file.h>
#include <surfel/io/record_table.h>
#include <surfel/store/surfel_source.h>

namespace surfel {

/// Surfels in the records of a binary file, decoded without a SurfelCloud in between. Records are
/// read block by block, so that a file of any size costs no memory. Only for records as this
/// library and most others write them: little-endian; positions float or double, all else float but
/// for colours, alpha (float, uchar, ushort), material and group (uchar, ushort), and source
/// (uint).
class RecordSource : public SurfelSource {
 public:
  /// Null where the records are of another form: read_cloud() reads them. Throws Error(kInput)
  /// where a coordinate, the variance and radius, or all records are missing. Keeps references to
  /// the file, which `table` is a view of, and to the table.
  /// \param bounds  World bounds of the positions, where they are known; else those that are double
  ///                are read for them.
  static std::unique_ptr<RecordSource> make(const InputFile& file, const RecordTable& table,
                                            const std::optional<Bounds>& bounds = {});

  std::size_t size() const override { return table_.count; }
  SurfelAttributes attributes() const override;
  Vec3d origin() const override { return origin_; }
  bool recenter(const Bounds& bounds) override;
  void fill(std::size_t begin, std::size_t end, RenderCloud& cloud, std::size_t row) const override;
  void fill_sources(std::size_t begin, std::size_t end, std::uint32_t* to) const override;
  void expect(std::size_t begin, std::size_t end) const override;

 private:
  /// A column, or where there is none, null.
  using Column = const RecordColumn*;
  using Columns = std::array<Column, 3>;

  RecordSource(const InputFile& file, const RecordTable& table) : file_(file), table_(table) {}
  bool find_columns();
  Bounds measure() const;
  void decode(const std::byte* records, std::size_t count, RenderCloud& cloud,
              std::size_t row) const;
  template <class T>
  void fill_positions(const std::byte* records, std::size_t count, RenderCloud& cloud,
                      std::size_t row) const;
  void fill_frames(const std::byte* records, std::size_t count, RenderCloud& cloud,
                   std::size_t row) const;
  void fill_colors(const std::byte* records, std::size_t count, RenderCloud& cloud,
                   std::size_t row) const;
  std::size_t offset(std::size_t record) const;
  const std::byte* read(std::size_t begin, std::size_t end) const;

  const InputFile& file_;
  const RecordTable& table_;
  Vec3d origin_{0, 0, 0};
  Columns position_{}, normal_{}, tangent_{}, color_{};
  Column variance_ = nullptr, radius_ = nullptr, variance_u_ = nullptr, variance_v_ = nullptr;
  Column area_ = nullptr, alpha_ = nullptr;
  Column material_ = nullptr, group_ = nullptr, group_radius_ = nullptr, source_ = nullptr;
};

}  // namespace surfel
