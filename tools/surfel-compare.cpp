// surfel-compare: how far is one picture from another, and is that near enough.

#include <cmath>
#include <optional>

#include <fmt/format.h>
#include <surfel/base/error.h>
#include <surfel/base/output_file.h>
#include <surfel/base/shell_quote.h>
#include <surfel/io/image_io.h>
#include <surfel/report/compare_page.h>
#include <surfel/scene/image.h>
#include <surfel/truth/image_error.h>

#include "tools/support/color.h"
#include "tools/support/options.h"
#include "tools/support/surfels.h"
#include "tools/support/tool.h"

namespace {

using surfel::Image;
using surfel::ImageError;
using surfel::tool::Json;
using surfel::tool::Tool;

/// Limits that the measures must keep; unset: none.
struct Limits {
  std::optional<double> min_psnr;
  std::optional<double> max_beyond;
  std::optional<double> max_holes;
};

struct Settings {
  std::string tested;
  std::string truth;
  std::string output;
  std::string html;  ///< Page to write; empty: none.
  double scale = 10;
  surfel::ImageErrorOptions options;
  Limits limits;
  bool json = false;
};

void declare(surfel::tool::CommandLine& app, Settings& s) {
  using surfel::ImageEncoding;
  namespace tool = surfel::tool;
  app.add_option("tested", s.tested, "Picture to judge (- = standard input)")->required();
  app.add_option("truth", s.truth, "Picture that it should equal, of the same size")->required();
  app.add_option("-o,--output", s.output,
                 "Picture of the differences to write: |tested - truth| times --scale");
  app.add_option("--html", s.html,
                 "Page to write: a slider between the pictures, their difference, a map of the "
                 "errors, all measures; it opens in a browser and needs no network");
  app.add_option("--scale", s.scale, "Factor of the differences in --output and --html, > 0");
  tool::add_choice(app, "--encoding", s.options.encoding,
                   {{"srgb", ImageEncoding::kSrgb}, {"linear", ImageEncoding::kLinear}},
                   "Compare what a viewer sees, clamped and encoded, or linear light as it is");
  tool::add_color(app, "--background", s.options.background,
                  "What both pictures are laid over: a name, #rrggbb, #rrggbbaa, or linear R,G,B "
                  "and straight alpha");
  app.add_flag("--inside", s.options.inside_only,
               "Compare colours only where both alphas are at least 0.99");
  app.add_option("--threshold", s.options.threshold,
                 "A pixel is beyond it when a colour channel differs by more, 0 to 1; the default "
                 "allows the one level of 8 bits that rounding can make");
  app.add_flag("--json", s.json, "Print JSON (psnr and alpha_psnr are null where nothing differs)");

  const std::string group = "Limits";
  app.add_option("--min-psnr", s.limits.min_psnr, "Least PSNR, dB")->group(group);
  app.add_option("--max-beyond", s.limits.max_beyond,
                 "Largest share of pixels beyond the threshold, 0 to 1")
      ->group(group);
  app.add_option("--max-holes", s.limits.max_holes,
                 "Largest share of holes: pixels with an alpha below 0.5 among those where the "
                 "truth's is at least 0.99, 0 to 1")
      ->group(group);
}

void check(const Settings& s) {
  std::vector<std::string> problems = s.options.problems();
  const auto require_share = [&](const char* name, const std::optional<double>& share) {
    if (share && !(*share >= 0 && *share <= 1)) {
      problems.push_back(fmt::format("{} is {}; it must be 0 to 1", name, *share));
    }
  };
  require_share("--max-beyond", s.limits.max_beyond);
  require_share("--max-holes", s.limits.max_holes);
  if (s.limits.min_psnr && std::isnan(*s.limits.min_psnr)) {
    problems.emplace_back("--min-psnr is no number");
  }
  if (!(std::isfinite(s.scale) && s.scale > 0)) {
    problems.push_back(fmt::format("--scale is {}; it must be greater than 0", s.scale));
  }
  if (s.tested == "-" && s.truth == "-") {
    problems.emplace_back("only one of the pictures can come from standard input");
  }
  if (s.output == "-") {
    problems.emplace_back("the measures go to standard output; name a file for --output");
  }
  if (s.html == "-") {
    problems.emplace_back("the measures go to standard output; name a file for --html");
  }
  surfel::tool::require_valid(problems);
}

/// One line of the table, one key of the JSON.
struct Measure {
  std::string key;
  Json value;
  std::string unit;
};

std::vector<Measure> measures(const ImageError& e, double threshold) {
  const std::string channel(1, "RGB"[e.channel]);
  // JSON knows no infinity: the library writes the PSNR of equal pictures as null.
  return {{"pixels", e.pixels, "compared"},
          {"nonfinite", e.nonfinite, "pixels with NaN or infinity, each a difference of 1"},
          {"psnr", e.psnr, "dB"},
          {"rmse", e.rmse, "of full scale"},
          {"mean_absolute", e.mean_absolute, "of full scale"},
          {"maximum", e.maximum, "of full scale"},
          {"maximum_x", e.x, "pixels from the left"},
          {"maximum_y", e.y, "pixels from the top"},
          {"maximum_channel", channel, ""},
          {"beyond", e.beyond, fmt::format("of the pixels differ by more than {:.4g}", threshold)},
          {"holes", e.holes, "of the truth's solid pixels"},
          {"alpha_psnr", e.alpha_psnr, "dB, alpha of all pixels"}};
}

std::string text_of(const Json& value) {
  return value.is_text()       ? value.text()
         : value.is_fraction() ? fmt::format("{:.5g}", value.number())
                               : value.dump();
}

std::string table(const std::vector<Measure>& measures) {
  std::string out;
  for (const auto& [key, value, unit] : measures) {
    const std::string text = text_of(value);
    out += unit.empty() ? fmt::format("{:16} {}\n", key, text)
                        : fmt::format("{:16} {:<10} {}\n", key, text, unit);
  }
  return out;
}

/// One sentence per limit that is not met.
std::vector<std::string> violations(const ImageError& e, const Limits& limits) {
  std::vector<std::string> out;
  const auto at_most = [&](const char* what, double share, const char* name,
                           const std::optional<double>& limit) {
    if (!limit || share <= *limit) return;
    out.push_back(fmt::format("the share {} is {:.5g}, {:.3g} above {} {:g}", what, share,
                              share - *limit, name, *limit));
  };
  if (limits.min_psnr && !(e.psnr >= *limits.min_psnr)) {
    out.push_back(fmt::format("the PSNR is {:.5g} dB, {:.3g} dB below --min-psnr {:g}", e.psnr,
                              *limits.min_psnr - e.psnr, *limits.min_psnr));
  }
  at_most("of pixels beyond the threshold", e.beyond, "--max-beyond", limits.max_beyond);
  at_most("of holes", e.holes, "--max-holes", limits.max_holes);
  const bool any_limit = limits.min_psnr || limits.max_beyond || limits.max_holes;
  if (any_limit && e.nonfinite > 0) {
    out.push_back(fmt::format("{} pixels are NaN or infinite, which no limit allows", e.nonfinite));
  }
  return out;
}

/// The page of the comparison.
std::string page_of(const Tool& tool, const Settings& s, const Image& tested, const Image& truth,
                    const std::vector<Measure>& found, const std::vector<std::string>& missed) {
  surfel::ComparePage page;
  page.tested = surfel::tool::shown_name(s.tested);
  page.truth = surfel::tool::shown_name(s.truth);
  for (const auto& [key, value, unit] : found) {
    page.figures.emplace_back(key, unit.empty() ? text_of(value) : text_of(value) + " " + unit);
  }
  page.missed = missed;
  page.limited = s.limits.min_psnr || s.limits.max_beyond || s.limits.max_holes;
  page.scale = s.scale;
  page.command = fmt::format(
      "surfel-compare {} {}{}", surfel::shell_file(s.tested), surfel::shell_file(s.truth),
      tool.options_given({"threads", "quiet", "verbose", "progress", "stats", "no-clobber"}));
  return surfel::compare_page_html(page, tested, truth, s.options);
}

}  // namespace

int main(int argc, char** argv) {
  Tool tool(
      "surfel-compare",
      "Measures how far a picture is from the true one. The exit status is 1 where a limit is "
      "not met; without limits it is 0 whatever the difference.");
  Settings s;
  declare(tool.app(), s);
  tool.everyday({"--output", "--html", "--scale", "--json", "--inside", "--background",
                 "--encoding", "--min-psnr", "--max-holes"},
                {"surfel-compare lion.png truth.png",
                 "surfel-compare lion.png truth.png -o difference.png --html lion.html",
                 "surfel-compare lion.exr truth.exr --min-psnr 35 --max-holes 0.001"});
  tool.reads_images();
  tool.files().reads({"tested", "truth"});
  tool.files().writes("--output", surfel::tool::Writes::kPicture);
  tool.files().writes("--html", surfel::tool::Writes::kPage);
  return tool.run(argc, argv, [&] {
    check(s);
    // What cannot be written fails before the work.
    std::optional<surfel::OutputFile> page;
    if (!s.html.empty()) page.emplace(s.html, tool.common().no_clobber);
    const Image tested = surfel::read_premultiplied_image(s.tested);
    const Image truth = surfel::read_premultiplied_image(s.truth);
    if (tested.width != truth.width || tested.height != truth.height) {
      surfel::throw_input(
          surfel::tool::shown_name(s.tested),
          fmt::format("has {}x{} pixels and {} {}x{}; render both at the same size", tested.width,
                      tested.height, surfel::tool::shown_name(s.truth), truth.width, truth.height));
    }
    const ImageError error = surfel::image_error(tested, truth, s.options);
    if (!s.output.empty()) {
      surfel::tool::write_picture(tool, surfel::difference_image(tested, truth, s.options, s.scale),
                                  s.output);
    }
    const std::vector<Measure> found = measures(error, s.options.threshold);
    const std::vector<std::string> missed = violations(error, s.limits);
    if (page) {
      page->write(page_of(tool, s, tested, truth, found, missed));
      page->commit();
      tool.wrote(s.html, "a page");
    }
    Json json;
    for (const Measure& measure : found) json[measure.key] = measure.value;
    tool.report()["compare"] = json;
    surfel::tool::print(s.json ? json.dump(2, Json::Members::kAsAdded) + "\n" : table(found));
    if (!missed.empty()) {
      surfel::throw_input(surfel::tool::shown_name(s.tested),
                          fmt::format("{}", fmt::join(missed, "; ")));
    }
  });
}
