#pragma once

#include <cstddef>

namespace surfel::laz {

/// What the points of a compressed file consist of, as bytes of LAS.
struct PointLayout {
  int format = 0;          ///< LAS point format, 0 to 10.
  std::size_t bytes = 20;  ///< Of a point, extra bytes with it.
  /// The version of the items that formats from 6 on consist of, 3 or 4. In the older one, what
  /// stands behind the first 30 bytes of a point has the models of channel 0 unless the point's
  /// scanner channel has just changed, and is predicted from the point before where models change.
  int layered_version = 3;

  bool layered() const { return format >= 6; }
  bool timed() const { return format == 1 || format >= 3; }
  bool colored() const {
    return format == 2 || format == 3 || format == 5 || format == 7 || format == 8 || format == 10;
  }
  bool infrared() const { return format == 8 || format == 10; }
  bool waves() const { return format == 4 || format == 5 || format >= 9; }
  /// Bytes before colour, waveform and extra bytes.
  std::size_t base() const { return layered() ? 30 : timed() ? 28 : 20; }
  /// Bytes of a point without extra bytes.
  std::size_t format_bytes() const {
    return base() + (colored() ? 6 : 0) + (infrared() ? 2 : 0) + (waves() ? 29 : 0);
  }
  std::size_t extra() const { return bytes - format_bytes(); }
};

}  // namespace surfel::laz
