#include <algorithm>
#include <array>
#include <cmath>

#include <surfel/scene/glyphs.h>

namespace surfel {
namespace {

/// Units of the strokes' grid in a capital's height. The baseline is at y = 6, the top of small
/// letters at 2; y grows downwards.
constexpr double kCapital = 6;
/// Half the width of a stroke, and the space between letters, units.
constexpr double kHalfStroke = 0.46;
constexpr double kSpace = 2;

/// Strokes of the characters from '!' on: lines through points "xy", parted by "|". One point twice
/// is a dot.
constexpr std::array<std::string_view, 94> kStrokes{
    "00 04|06 06",                                         // !
    "00 02|20 22",                                         // "
    "10 16|30 36|02 42|04 44",                             // #
    "41 30 10 01 02 13 33 44 45 36 16 05|20 26",           // $
    "06 40|00 10 11 01 00|35 45 46 36 35",                 // %
    "46 02 01 10 20 31 32 04 05 16 26 44",                 // &
    "00 02",                                               // '
    "10 02 04 16",                                         // (
    "00 12 14 06",                                         // )
    "11 35|31 15|03 43",                                   // *
    "03 43|21 25",                                         // +
    "15 16 07",                                            // ,
    "03 33",                                               // -
    "06 06",                                               // .
    "06 30",                                               // /
    "10 30 41 45 36 16 05 01 10",                          // 0
    "02 20 26|06 46",                                      // 1
    "01 10 30 41 42 06 46",                                // 2
    "01 10 30 41 42 33 13|33 44 45 36 16 05",              // 3
    "36 30 04 44",                                         // 4
    "40 00 02 32 43 45 36 16 05",                          // 5
    "41 30 10 01 05 16 36 45 43 32 12 03",                 // 6
    "00 40 16",                                            // 7
    "10 30 41 42 33 13 02 01 10|13 04 05 16 36 45 44 33",  // 8
    "05 16 36 45 41 30 10 01 03 14 34 43",                 // 9
    "03 03|06 06",                                         // :
    "13 13|15 16 07",                                      // ;
    "31 03 35",                                            // <
    "02 42|04 44",                                         // =
    "01 33 05",                                            // >
    "01 10 30 41 42 23 24|26 26",                          // ?
    "46 16 05 01 10 30 41 44 34 32 22 13 24 34",           // @
    "06 20 46|14 34",                                      // A
    "00 06 36 45 44 33 03|33 42 41 30 00",                 // B
    "41 30 10 01 05 16 36 45",                             // C
    "00 06 26 45 41 20 00",                                // D
    "40 00 06 46|03 33",                                   // E
    "40 00 06|03 33",                                      // F
    "41 30 10 01 05 16 36 45 43 23",                       // G
    "00 06|40 46|03 43",                                   // H
    "00 20|10 16|06 26",                                   // I
    "40 45 36 16 05",                                      // J
    "00 06|40 03 46",                                      // K
    "00 06 46",                                            // L
    "06 00 23 40 46",                                      // M
    "06 00 46 40",                                         // N
    "10 30 41 45 36 16 05 01 10",                          // O
    "06 00 30 41 42 33 03",                                // P
    "10 30 41 45 36 16 05 01 10|34 46",                    // Q
    "06 00 30 41 42 33 03|23 46",                          // R
    "41 30 10 01 02 13 33 44 45 36 16 05",                 // S
    "00 40|20 26",                                         // T
    "00 05 16 36 45 40",                                   // U
    "00 26 40",                                            // V
    "00 16 22 36 40",                                      // W
    "00 46|06 40",                                         // X
    "00 23 40|23 26",                                      // Y
    "00 40 06 46",                                         // Z
    "10 00 06 16",                                         // [
    "00 36",                                               // backslash
    "00 10 16 06",                                         // ]
    "02 20 42",                                            // ^
    "07 47",                                               // _
    "00 11",                                               // `
    "12 22 33 36|34 14 05 16 26 35",                       // a
    "00 06 26 35 33 22 02",                                // b
    "33 22 12 03 05 16 26 35",                             // c
    "30 36 16 05 03 12 32",                                // d
    "04 34 33 22 12 03 05 16 36",                          // e
    "30 20 11 16|02 22",                                   // f
    "32 12 03 05 16 36|32 37 28 08",                       // g
    "00 06|03 12 22 33 36",                                // h
    "02 06|00 00",                                         // i
    "12 17 08|10 10",                                      // j
    "00 06|32 04 36",                                      // k
    "00 05 16",                                            // l
    "06 02|03 12 23 26|23 32 43 46",                       // m
    "06 02|03 12 22 33 36",                                // n
    "12 22 33 35 26 16 05 03 12",                          // o
    "08 02 22 33 35 26 06",                                // p
    "38 32 12 03 05 16 36",                                // q
    "06 02|03 12 22",                                      // r
    "32 12 03 14 24 35 26 06",                             // s
    "10 15 26|02 22",                                      // t
    "02 05 16 36|32 36",                                   // u
    "02 26 42",                                            // v
    "02 16 23 36 42",                                      // w
    "02 36|06 32",                                         // x
    "02 05 16 36|32 37 28 08",                             // y
    "02 32 06 36",                                         // z
    "20 11 12 03 14 15 26",                                // {
    "00 07",                                               // |
    "00 11 12 23 14 15 06",                                // }
    "04 13 24 33",                                         // ~
};

std::string_view strokes(char c) {
  const auto place = static_cast<std::size_t>(static_cast<unsigned char>(c) - '!');
  if (c == ' ') return {};
  return c > ' ' && place < kStrokes.size() ? kStrokes[place] : "00 40 46 06 00";
}

/// Calls visit(a, b) for the lines of a character, units.
template <class Visit>
void visit_lines(std::string_view strokes, Visit&& visit) {
  const auto point = [&](std::size_t i) { return Vec2d(strokes[i] - '0', strokes[i + 1] - '0'); };
  for (std::size_t i = 0; i + 3 < strokes.size(); i += 3) {
    if (strokes[i + 2] != '|') visit(point(i), point(i + 3));
  }
}

/// From a character's left to the next character's, units.
double advance(char c) {
  if (c == ' ') return kSpace + 1;
  double width = 0;
  visit_lines(strokes(c), [&](const Vec2d& a, const Vec2d& b) {
    width = std::max({width, a.x(), b.x()});
  });
  return width + kSpace;
}

double distance(const Vec2d& p, const Vec2d& a, const Vec2d& b) {
  const Vec2d along = b - a;
  const double length2 = along.squaredNorm();
  const double t = length2 > 0 ? std::clamp((p - a).dot(along) / length2, 0.0, 1.0) : 0;
  return (p - a - t * along).norm();
}

}  // namespace

double text_width(std::string_view text) {
  if (text.empty()) return 0;
  double units = -kSpace;
  for (const char c : text) units += advance(c);
  return (units + 2 * kHalfStroke) / kCapital;
}

void blend_over(float* pixel, const Vec3f& color, double cover) {
  const auto c = static_cast<float>(cover);
  for (int k = 0; k < 3; ++k) pixel[k] += c * (color[k] - pixel[k]);
  pixel[3] += c * (1 - pixel[3]);
}

void draw_text(Image& image, std::string_view text, double left, double baseline, double height,
               const Vec3f& color) {
  const double unit = height / kCapital;
  const double half = kHalfStroke * unit;
  constexpr double kDescent = 2;  ///< Units below the baseline that letters reach.
  constexpr double kWidest = 4;
  const auto clamped = [](double x, int size) {
    return static_cast<int>(std::clamp(x, 0.0, static_cast<double>(size)));
  };
  double x0 = left + half;
  for (const char c : text) {
    const Vec2d origin(x0, baseline - height);
    const int begin_y = clamped(origin.y() - half - 1, image.height);
    const int end_y = clamped(baseline + kDescent * unit + half + 2, image.height);
    const int end_x = clamped(x0 + kWidest * unit + half + 2, image.width);
    for (int y = begin_y; y < end_y; ++y) {
      for (int x = clamped(x0 - half - 1, image.width); x < end_x; ++x) {
        const Vec2d p = (Vec2d(x + 0.5, y + 0.5) - origin) / unit;
        double nearest = kCapital;
        visit_lines(strokes(c), [&](const Vec2d& a, const Vec2d& b) {
          nearest = std::min(nearest, distance(p, a, b));
        });
        // Part of the pixel's width that a straight stroke covers at that distance.
        const double d = nearest * unit;
        const double cover = std::min(d + half, 0.5) - std::max(d - half, -0.5);
        if (cover > 0) blend_over(image.pixel(x, y), color, std::min(cover, 1.0));
      }
    }
    x0 += advance(c) * unit;
  }
}

}  // namespace surfel
