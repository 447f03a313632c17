#include <algorithm>
#include <array>
#include <cmath>

#include <fmt/format.h>
#include <surfel/base/color.h>
#include <surfel/base/elementary.h>
#include <surfel/measure/cloud_statistics.h>
#include <surfel/report/compare_page.h>
#include <surfel/report/page.h>
#include <surfel/report/page_chart.h>
#include <surfel/scene/color_map.h>

namespace surfel {
namespace {

/// A level of 8 bits.
constexpr double kLevel = 1.0 / 255;

/// A picture as viewers show it: over the background, if that is no nothing.
Image over(const Image& image, const std::array<float, 4>& background) {
  const auto channel = [&](const char* name) {
    const auto found = std::find(image.channels.begin(), image.channels.end(), name);
    return found == image.channels.end() ? -1 : static_cast<int>(found - image.channels.begin());
  };
  const std::array<int, 4> channels{channel("R"), channel("G"), channel("B"), channel("A")};
  Image out = rgba_image(image.width, image.height);
  for (int y = 0; y < image.height; ++y) {
    for (int x = 0; x < image.width; ++x) {
      const float* from = image.pixel(x, y);
      float* to = out.pixel(x, y);
      const float alpha = channels[3] < 0 ? 1.0F : from[channels[3]];
      const float left = 1 - alpha;
      for (std::size_t c = 0; c < 3; ++c) {
        to[c] = from[channels[c]] + left * background[c] * background[3];
      }
      to[3] = alpha + left * background[3];
    }
  }
  return out;
}

/// The largest difference of each pixel's colour channels, of full scale.
std::vector<double> errors_of(const Image& differences, ImageEncoding encoding) {
  std::vector<double> errors;
  errors.reserve(static_cast<std::size_t>(differences.width) *
                 static_cast<std::size_t>(differences.height));
  for (int y = 0; y < differences.height; ++y) {
    for (int x = 0; x < differences.width; ++x) {
      const float* pixel = differences.pixel(x, y);
      float most = std::max({pixel[0], pixel[1], pixel[2]});
      if (encoding == ImageEncoding::kSrgb) most = linear_to_srgb(most);
      errors.push_back(static_cast<double>(most));
    }
  }
  return errors;
}

/// The end of a scale: the least 1, 2 or 5 times a power of ten that is not below the value.
double scale_end(double value) {
  const double power = portable::pow(10.0, std::floor(portable::log10(value)));
  for (const double step : {1.0, 2.0, 5.0}) {
    if (value <= step * power * (1 + 1e-9)) return step * power;
  }
  return 10 * power;
}

Image error_map(const std::vector<double>& errors, int width, int height, double most) {
  const ColorTable color(ColorMap::kTurbo);
  Image image = rgba_image(width, height);
  for (std::size_t i = 0; i < errors.size(); ++i) {
    float* to = image.data.data() + 4 * i;
    const Vec3f shown = color(std::clamp(errors[i] / most, 0.0, 1.0));
    std::copy_n(shown.data(), 3, to);
    to[3] = 1;
  }
  return image;
}

std::string slider_html(const ComparePage& page, PagePictures& pictures, const Image& tested,
                        const Image& truth) {
  return fmt::format(
      "<div class=\"compare\" id=\"compare\">{}<div class=\"over\">{}</div>"
      "<div class=\"edge\"></div><span class=\"first\">{}</span>"
      "<span class=\"second\">{}</span></div>\n"
      "<input class=\"slide\" id=\"slide\" type=\"range\" min=\"0\" max=\"100\" step=\"0.1\" "
      "value=\"50\" aria-label=\"Place of the border between the pictures\">\n",
      pictures.add(truth), pictures.add(tested), escape_html(page.tested), escape_html(page.truth));
}

// The border follows the range below the pictures, and the pointer over them.
const char* const kScript = R"(const box = document.getElementById('compare');
const slide = document.getElementById('slide');
const put = (at) => box.style.setProperty('--at', at + '%');
slide.addEventListener('input', () => put(slide.value));
const follow = (event) => {
  const area = box.getBoundingClientRect();
  slide.value = Math.min(100, Math.max(0, 100 * (event.clientX - area.left) / area.width));
  put(slide.value);
};
box.addEventListener('pointerdown', follow);
box.addEventListener('pointermove', (event) => { if (event.buttons) follow(event); });
box.style.touchAction = 'pan-y';
)";

std::string verdict_html(const ComparePage& page) {
  if (!page.limited) return {};
  if (page.missed.empty()) return "<p class=\"verdict\">All limits are met.</p>\n";
  std::string out;
  for (const std::string& sentence : page.missed) {
    out += "<p class=\"verdict off\">" + escape_html(sentence) + "</p>\n";
  }
  return out;
}

}  // namespace

std::string compare_page_html(const ComparePage& page, const Image& tested, const Image& truth,
                              const ImageErrorOptions& options) {
  const Image differences = difference_image(tested, truth, options, 1);
  const std::vector<double> errors = errors_of(differences, options.encoding);
  // A few pixels with large errors must not make all others look alike.
  std::vector<double> sorted = errors;
  std::sort(sorted.begin(), sorted.end());
  const double largest = scale_end(std::max(sorted.back(), kLevel));
  const double most = scale_end(std::max(sorted[rank_of(0.999, sorted.size())], kLevel));
  const char* const unit = "of full scale";
  PagePictures pictures;
  std::string body =
      verdict_html(page) + slider_html(page, pictures, over(tested, options.background),
                                       over(truth, options.background));
  body += "<h2>Measures</h2>\n" + facts_html(page.figures);
  body += "<h2>Where they differ</h2>\n<div class=\"gallery\">\n";
  body +=
      figure_html("difference", pictures.add(difference_image(tested, truth, options, page.scale)),
                  fmt::format("the difference of each channel, times {:g}", page.scale));
  body += figure_html(
      "", pictures.add(error_map(errors, differences.width, differences.height, most)),
      "the largest difference of a pixel's channels, by the scale below; larger ones than its end "
      "have its colour");
  body += "</div>\n<div class=\"charts\">\n";
  body += figure_html("chart", color_scale_svg(ColorMap::kTurbo, 0, most, ""),
                      fmt::format("<b>scale of the map</b>; {}, {} is a level of 8 bits", unit,
                                  shown_number(kLevel)));
  constexpr std::size_t kBins = 50;
  body += figure_html(
      "chart", histogram_svg(histogram_of(errors, 0, largest, kBins), true),
      fmt::format("<b>pixels by their difference</b>; {}, heights are logarithms", unit));
  body += "</div>\n<h2>To repeat it</h2>\n" + pre_html(page.command);
  const auto last_part = [](const std::string& path) { return path.substr(path.rfind('/') + 1); };
  return page_html(
      {.title = fmt::format("{} and {}", last_part(page.tested), last_part(page.truth)),
       .heading = "How far a picture is from the true one",
       .subtitle = fmt::format("{} beside {}, by surfel-compare", page.tested, page.truth),
       .body_html = body,
       .script = kScript});
}

}  // namespace surfel
