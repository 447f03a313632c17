#include <algorithm>
#include <cmath>
#include <numeric>

#include <fmt/format.h>
#include <surfel/base/elementary.h>
#include <surfel/render/legend.h>
#include <surfel/scene/glyphs.h>

namespace surfel {
namespace {

// Lengths are in heights of a capital unless they are in pixels.
constexpr double kCapitalShare = 0.018;  ///< Height of a capital by the picture's shorter side.
constexpr double kLeastCapital = 7;      ///< Pixels.
constexpr double kMargin = 1.2;          ///< Around the panel.
constexpr double kPad = 1.1;             ///< Inside of the panel.
constexpr double kTitleSpace = 1.3;      ///< Between the title and what is below.
constexpr double kRow = 1.9;             ///< From entry to entry.
constexpr double kSwatch = 1.2;          ///< Width of the bar, and of an entry's colour.
constexpr double kGap = 0.7;             ///< Between the colours and their texts.
constexpr double kTick = 0.35;           ///< Length of a tick beside the bar.
constexpr double kTickSpace = 2.2;       ///< Least distance of ticks.
constexpr double kBarShare = 0.3;        ///< Height of the bar by the picture's, but at most
constexpr double kLongestBar = 20;       ///< this.
constexpr double kEntriesShare = 0.7;    ///< Height of all entries by the picture's, at most.
constexpr double kPanelCover = 0.78;

const Vec3f kPanel(1, 1, 1);
const Vec3f kInk(0.012F, 0.012F, 0.012F);

/// The text, cut short to a width in heights of a capital.
std::string cut_short(const std::string& text, double width) {
  if (text_width(text) <= width) return text;
  std::string head = text;
  while (!head.empty() && text_width(head + "...") > width) head.pop_back();
  return head + "...";
}

/// The entries that there is room for, in their order.
std::vector<Legend::Entry> shown_entries(const std::vector<Legend::Entry>& all, std::size_t most) {
  if (all.size() <= most) return all;
  std::vector<std::size_t> order(all.size());
  std::iota(order.begin(), order.end(), std::size_t{0});
  std::stable_sort(order.begin(), order.end(),
                   [&](std::size_t a, std::size_t b) { return all[a].count > all[b].count; });
  order.resize(most - 1);
  std::sort(order.begin(), order.end());
  std::vector<Legend::Entry> shown;
  for (const std::size_t i : order) shown.push_back(all[i]);
  shown.push_back({kPanel, fmt::format("and {} more", all.size() - shown.size()), 0});
  return shown;
}

/// Blends a rectangle of whole pixels; color(y) is the colour of a row.
template <class Color>
void fill_box(Image& image, int left, int top, int right, int bottom, double cover, Color&& color) {
  for (int y = top; y < bottom; ++y) {
    const Vec3f c = color(y);
    for (int x = left; x < right; ++x) blend_over(image.pixel(x, y), c, cover);
  }
}

int rounded(double x) { return static_cast<int>(std::lround(x)); }

}  // namespace

std::vector<Tick> round_ticks(double min, double max, int most) {
  const double largest = std::max(std::abs(min), std::abs(max));
  const bool exponents = largest > 0 && (largest < 1e-3 || largest >= 1e9);
  // Numbers nearer to each other than this have no decimals to tell them apart.
  constexpr double kLeastShare = 1e-12;
  if (!(max - min > kLeastShare * largest) || !std::isfinite(max - min)) {
    return {{min, fmt::format("{:.10g}", min)}};
  }
  int power = static_cast<int>(std::floor(portable::log10((max - min) / most)));
  int factor = 1;
  const auto step = [&] { return factor * portable::pow(10.0, power); };
  // A range of n steps may hold n + 1 multiples.
  while ((max - min) / step() >= most * (1 - 1e-6)) {
    factor = factor == 1 ? 2 : factor == 2 ? 5 : 1;
    if (factor == 1) ++power;
  }
  const double slack = 1e-7 * (max - min);  // Of rounding.
  const auto first = std::ceil((min - slack) / step());
  std::vector<Tick> ticks;
  for (double i = first; i * step() <= max + slack; ++i) {
    const double value = i * step() + 0.0;
    const int digits = static_cast<int>(std::floor(portable::log10(largest))) - power;
    ticks.push_back({value, exponents ? fmt::format("{:.{}e}", value, std::clamp(digits, 0, 15))
                                      : fmt::format("{:.{}f}", value, std::max(0, -power))});
  }
  return ticks;
}

bool draw_legend(const Legend& legend, Image& image) {
  const int shorter = std::min(image.width, image.height);
  if (shorter < Legend::kLeastPixels) return false;
  const double em = std::max(kLeastCapital, kCapitalShare * shorter);
  const double room = image.width / em - 2 * (kMargin + kPad);
  const std::string title = cut_short(legend.title, room);

  const auto most_rows = static_cast<std::size_t>(kEntriesShare * image.height / (kRow * em));
  std::vector<Legend::Entry> entries = shown_entries(legend.entries, most_rows);
  const bool bar = entries.empty();
  const double body = bar ? std::min(kBarShare * image.height, kLongestBar * em)
                          : em * kRow * static_cast<double>(entries.size());
  const std::vector<Tick> ticks =
      bar ? round_ticks(legend.min, legend.max, static_cast<int>(body / (kTickSpace * em)))
          : std::vector<Tick>{};
  double texts = 0;
  for (const Tick& tick : ticks) texts = std::max(texts, text_width(tick.text));
  for (Legend::Entry& entry : entries) {
    entry.text = cut_short(entry.text, room - kSwatch - kGap);
    texts = std::max(texts, text_width(entry.text));
  }
  const double width = std::max(text_width(title), kSwatch + kGap + texts) + 2 * kPad;
  const double height = (2 * kPad + 1 + kTitleSpace) * em + body;

  const int right = image.width - rounded(kMargin * em);
  const int bottom = image.height - rounded(kMargin * em);
  const int left = right - rounded(width * em);
  const int top = bottom - rounded(height);
  fill_box(image, left, top, right, bottom, kPanelCover, [](int) { return kPanel; });
  const double text_left = left + kPad * em;
  draw_text(image, title, text_left, top + (kPad + 1) * em, em, kInk);

  const int body_left = rounded(text_left);
  const int body_right = body_left + rounded(kSwatch * em);
  const int body_top = top + rounded((kPad + 1 + kTitleSpace) * em);
  const double labels = body_right + kGap * em;
  for (std::size_t i = 0; i < entries.size(); ++i) {
    const int row = body_top + rounded(kRow * em * static_cast<double>(i));
    fill_box(image, body_left, row, body_right, row + rounded(kSwatch * em), 1,
             [&](int) { return entries[i].color; });
    draw_text(image, entries[i].text, labels, row + (kSwatch + 1) / 2 * em, em, kInk);
  }
  if (!bar) return true;
  const int rows = rounded(body);
  const int body_bottom = body_top + rows;
  fill_box(image, body_left, body_top, body_right, body_bottom, 1,
           [&](int y) { return map_color(legend.map, (body_bottom - y - 0.5) / rows); });
  for (const Tick& tick : ticks) {
    const double t =
        legend.max > legend.min ? (tick.value - legend.min) / (legend.max - legend.min) : 0.5;
    const double y = body_bottom - t * rows;
    const int line = std::clamp(static_cast<int>(y), body_top, body_bottom - 1);
    fill_box(image, body_right, line, body_right + rounded(kTick * em),
             std::min(body_bottom, line + std::max(1, rounded(em / 10))), 1,
             [](int) { return kInk; });
    draw_text(image, tick.text, labels, y + em / 2, em, kInk);
  }
  return true;
}

}  // namespace surfel
