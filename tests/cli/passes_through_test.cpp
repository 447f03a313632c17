// What only passes through a tool is written with the value that was read, whatever stands beside.

#include <algorithm>
#include <array>
#include <cmath>
#include <functional>
#include <limits>
#include <map>
#include <random>

#include <fmt/format.h>
#include <fmt/ranges.h>
#include <gtest/gtest.h>

#include "support/point_files.h"
#include "support/run_tool.h"

namespace surfel::test {
namespace {

/// How coordinates are told.
enum class Values {
  kMillimetres,  ///< Decimals within 20 units.
  kProducts,     ///< Doubles next to them: whole numbers times 0.001.
  kSurvey,       ///< Millimetres within 100,000 units.
  kDoubles,      ///< Random doubles of 17 digits.
  kFloats,
};
constexpr std::size_t kValues = 5;
constexpr double kMoves[] = {1, 1e3, 1e5, 1e7};
enum class Beside { kNothing, kStray, kStrays, kNotANumber, kUnfit };
constexpr std::size_t kBesides = 5;

enum class Keeps { kAll, kInBox, kEverySecond, kMost, kFirstFile };

struct Command {
  const char* name;
  /// IN, OUT and OTHER stand for files, BOX for one around the cloud, COUNT for its points.
  const char* line;
  enum Inputs { kAnyInput, kSigned, kSurfels, kRanges, kBare } inputs = kAnyInput;
  enum Outputs { kAnyOutput, kPly } outputs = kAnyOutput;
  Keeps keeps = Keeps::kAll;
};

constexpr Command kCommands[] = {
    {"Convert", "surfel-convert IN -o OUT"},
    {"ConvertAscii", "surfel-convert IN --ascii -o OUT", Command::kAnyInput, Command::kPly},
    {"ConvertPipe", "surfel-convert - -o -", Command::kSigned, Command::kPly},
    {"ConvertColumns", "surfel-convert IN --keep-columns intensity -o OUT"},
    {"ConvertUnmoved", "surfel-convert IN --scale 1 --translate 0,0,0 --epsg 25832 -o OUT"},
    {"ConvertBounds", "surfel-convert IN --bounds BOX -o OUT", Command::kAnyInput,
     Command::kAnyOutput, Keeps::kInBox},
    {"ConvertEvery", "surfel-convert IN --every 2 -o OUT", Command::kAnyInput, Command::kAnyOutput,
     Keeps::kEverySecond},
    {"ConvertSort", "surfel-convert IN --sort curve -o OUT", Command::kAnyInput, Command::kPly},
    {"ConvertSortOnDisk", "surfel-convert IN --sort curve --memory 4K -o OUT", Command::kAnyInput,
     Command::kPly},
    {"ConvertJoin", "surfel-convert IN OTHER -o OUT"},
    {"ConvertAlign", "surfel-convert IN OTHER --align -o OUT", Command::kAnyInput,
     Command::kAnyOutput, Keeps::kFirstFile},
    {"ConvertNamed", "surfel-convert IN --columns NAMES -o OUT", Command::kBare},
    {"Estimate", "surfel-estimate IN -o OUT"},
    {"EstimateNamed", "surfel-estimate IN --columns NAMES -o OUT", Command::kBare},
    {"EstimateOutliers", "surfel-estimate IN --remove-outliers -o OUT", Command::kAnyInput,
     Command::kAnyOutput, Keeps::kMost},
    {"EstimateBlocks", "surfel-estimate IN --resume -o OUT", Command::kRanges, Command::kPly},
    {"Group", "surfel-group IN -o OUT", Command::kSurfels},
    {"GroupCopies", "surfel-group IN --groups 4 --cover duplicate -o OUT", Command::kSurfels},
    {"Levels", "surfel-lod IN -o OUT", Command::kSurfels, Command::kPly},
    {"LevelsBlocks", "surfel-lod IN --resume -o OUT", Command::kRanges, Command::kPly},
    {"Simplify", "surfel-simplify IN --count COUNT -o OUT", Command::kSurfels},
    {"Texture", "surfel-texture IN --solid checker -o OUT", Command::kSurfels},
    {"TextureBlocks", "surfel-texture IN --solid checker --resume -o OUT", Command::kRanges,
     Command::kPly},
    {"RenderKeep", "surfel-render IN --keep OUT -o picture.png --size 16x16"},
};
constexpr std::size_t kCommandCount = std::size(kCommands);

struct Input {
  PointFormat format;
  const char* name;
};
constexpr Input kInputs[] = {
    {PointFormat::kPlyText, "text.ply"},
    {PointFormat::kPlyLittle, "little.ply"},
    {PointFormat::kPlyBig, "big.ply"},
    {PointFormat::kCsv, "in.csv"},
    {PointFormat::kXyz, "in.xyz"},
    {PointFormat::kBareText, "in.txt"},
    {PointFormat::kPcdText, "text.pcd"},
    {PointFormat::kPcdBinary, "binary.pcd"},
    {PointFormat::kPcdCompressed, "lzf.pcd"},
    {PointFormat::kLas, "in.las"},
    {PointFormat::kLaz, "in.laz"},
    {PointFormat::kPtx, "in.ptx"},
    {PointFormat::kE57, "reals.e57"},
    {PointFormat::kE57Steps, "steps.e57"},
};
constexpr const char* kOutputs[] = {"out.ply", "out.pcd", "out.las", "out.laz",
                                    "out.xyz", "out.csv", "out.txt", "out.obj"};

bool is_las(PointFormat format) {
  return format == PointFormat::kLas || format == PointFormat::kLaz;
}
bool is_signed(PointFormat format) {
  return format != PointFormat::kCsv && format != PointFormat::kXyz &&
         format != PointFormat::kBareText && format != PointFormat::kPtx;
}
bool has_steps(PointFormat format) { return is_las(format) || format == PointFormat::kE57Steps; }
bool has_columns(PointFormat format) {
  return format != PointFormat::kPtx && format != PointFormat::kE57 &&
         format != PointFormat::kE57Steps;
}
bool is_las_name(const std::string& name) { return name.ends_with("las") || name.ends_with("laz"); }

/// One choice of everything: places in the tables above.
struct Case {
  enum Part { kCommand, kInput, kOutput, kValue, kMove, kBeside, kParts };
  std::array<std::size_t, kParts> of{};

  const Command& command() const { return kCommands[of[kCommand]]; }
  const Input& input() const { return kInputs[of[kInput]]; }
  std::string output() const { return kOutputs[of[kOutput]]; }
  Values values() const { return static_cast<Values>(of[kValue]); }
  double move() const { return kMoves[of[kMove]]; }
  Beside beside() const { return static_cast<Beside>(of[kBeside]); }

  bool possible() const {
    const PointFormat format = input().format;
    const bool steps = has_steps(format);
    const bool decimal = values() == Values::kMillimetres || values() == Values::kSurvey;
    if (steps && !decimal) return false;
    if (steps && beside() == Beside::kNotANumber) return false;
    if (is_las(format) && beside() == Beside::kUnfit) return false;
    if (command().outputs == Command::kPly && output() != "out.ply") return false;
    const bool bare = format == PointFormat::kBareText;
    switch (command().inputs) {
      case Command::kSigned:
        return is_signed(format);
      case Command::kBare:
        return bare;
      case Command::kSurfels:
        return has_columns(format) && !bare;
      case Command::kRanges:
        return format == PointFormat::kPlyLittle || format == PointFormat::kPlyBig;
      default:
        return !bare;
    }
  }
};

/// Calls visit(case) for all that are possible.
void for_all_cases(const std::function<void(const Case&)>& visit) {
  constexpr std::size_t kSizes[] = {kCommandCount, std::size(kInputs), std::size(kOutputs),
                                    kValues,       std::size(kMoves),  kBesides};
  for (Case next; next.of[Case::kParts - 1] < kSizes[Case::kParts - 1];) {
    if (next.possible()) visit(next);
    for (std::size_t part = 0; part < Case::kParts; ++part) {
      if (++next.of[part] < kSizes[part] || part + 1 == Case::kParts) break;
      next.of[part] = 0;
    }
  }
}

/// Cases among which each two of their choices that are possible together meet; all cases where the
/// tests are to be thorough.
std::vector<Case> chosen_cases() {
  std::vector<Case> all;
  for_all_cases([&](const Case& next) { all.push_back(next); });
  const char* const thorough = std::getenv("SURFEL_TEST_THOROUGH");
  if (thorough && *thorough) return all;
  std::shuffle(all.begin(), all.end(), std::mt19937(1));
  constexpr std::size_t kMost = 32;  // Choices of a part.
  std::vector<bool> met(kMost * kMost * Case::kParts * Case::kParts);
  std::vector<Case> chosen;
  // First the cases in which much meets that has not met.
  for (const int least : {15, 12, 9, 6, 3, 1}) {
    for (const Case& next : all) {
      std::array<std::size_t, 15> pairs;
      std::size_t count = 0;
      for (std::size_t a = 0; a < Case::kParts; ++a) {
        for (std::size_t b = 0; b < a; ++b) {
          pairs[count++] = ((a * Case::kParts + b) * kMost + next.of[a]) * kMost + next.of[b];
        }
      }
      const auto is_new = [&](std::size_t pair) { return !met[pair]; };
      if (std::count_if(pairs.begin(), pairs.end(), is_new) < least) continue;
      for (const std::size_t pair : pairs) met[pair] = true;
      chosen.push_back(next);
    }
  }
  return chosen;
}

/// A slightly bent plane of 256 points in the order of a curve that fills it.
class TestCloud {
 public:
  static constexpr std::size_t kSide = 16;

  TestCloud(const Case& c, Values values, Beside beside) {
    const bool survey = c.values() == Values::kSurvey;
    // Floats must tell the points apart.
    const bool wide = c.values() == Values::kFloats && c.move() > 1e3;
    const double extent = survey ? 1e5 : wide ? c.move() / 100 : 20;
    // 32 bits of millimetres do not reach 10,000 kilometres.
    if (is_las(c.input().format) && c.move() > 1e6) file.per_unit = 100;
    file.single = values == Values::kFloats;
    file.offset = is_las(c.input().format) ? c.move() : 0;
    const double spacing = extent / kSide;
    file.variance = static_cast<float>(spacing * spacing);
    for (std::size_t i = 0; i < kSide * kSide; ++i) {
      double u = 0;
      double v = 0;
      for (unsigned bit = 0; bit < 4; ++bit) {
        u += static_cast<double>(i >> (2 * bit) & 1U) * (1U << bit);
        v += static_cast<double>(i >> (2 * bit + 1) & 1U) * (1U << bit);
      }
      const auto at = [&](double place) { return (place + 0.3 * random()) * spacing; };
      add(values, {c.move() + at(u), -c.move() + at(v), c.move() / 10 + at(0.02 * u * v)});
    }
    core_ = box_of(file.places);
    add_beside(beside);
  }

  /// The corners of a box around the cloud without strays.
  std::string box() const {
    std::vector<std::string> corners;
    for (const Place& corner : core_) {
      for (const double x : corner) corners.push_back(shortest(x));
    }
    return fmt::format("{}", fmt::join(corners, ","));
  }
  bool in_box(const Place& p) const {
    for (std::size_t axis = 0; axis < 3; ++axis) {
      if (!(p[axis] >= core_[0][axis] && p[axis] <= core_[1][axis])) return false;
    }
    return true;
  }
  static bool finite(const Place& p) { return std::isfinite(p[0] + p[1] + p[2]); }

  FilePoints file;

 private:
  double random() { return static_cast<double>(engine_()) / 4294967296.0; }
  void add(Values values, Place p) {
    for (double& x : p) {
      if (values == Values::kFloats) x = static_cast<float>(x);
      if (values == Values::kMillimetres || values == Values::kSurvey) {
        x = std::round(x * file.per_unit) / file.per_unit;
      }
      if (values == Values::kProducts) x = std::round(x * 1000) * 0.001;
    }
    file.places.push_back(p);
  }
  static std::array<Place, 2> box_of(const std::vector<Place>& places) {
    std::array<Place, 2> box{places[0], places[0]};
    for (const Place& p : places) {
      for (std::size_t axis = 0; axis < 3; ++axis) {
        box[0][axis] = std::min(box[0][axis], p[axis] - 1);
        box[1][axis] = std::max(box[1][axis], p[axis] + 1);
      }
    }
    return box;
  }
  void add_beside(Beside beside) {
    const auto stray = [&](double x) { return Place{x, 0, 0}; };
    if (beside == Beside::kStray) file.places.insert(file.places.begin(), stray(0));
    if (beside == Beside::kStrays) {
      for (int i = 50; i-- > 0;) file.places.insert(file.places.begin(), stray(0.25 * i));
    }
    if (beside == Beside::kNotANumber) {
      const double nan = std::numeric_limits<double>::quiet_NaN();
      file.places.push_back({nan, nan, nan});
    }
    if (beside == Beside::kUnfit) file.first_intensity = 70000.5F;
  }

  std::mt19937 engine_{1};
  std::array<Place, 2> core_;
};

/// What a file holds, or should: the triples of coordinates in words, and how often.
using Triples = std::map<std::string, int>;

class PassesThrough : public testing::TestWithParam<std::size_t> {
 protected:
  void check(const Case& c);

 private:
  TemporaryFolder folder_;
};

/// What a coordinate is compared by: equal where it was written with the value that was read.
/// \param coordinate  as it stands in the file that was read, or, if `found`, in the written one
std::string word_of(double coordinate, bool found, std::size_t axis, const Case& c,
                    const FilePoints& file, const WrittenPoints& written) {
  if (is_las_name(c.output())) {
    return fmt::format("{:.0f}",
                       std::round((coordinate - written.offset[axis]) / written.scale[axis]));
  }
  const auto single = static_cast<float>(coordinate);
  // Decimals of text that are written as floats mean the same as text again, and the reverse.
  if (is_text(c.input().format)) {
    if (found && written.single) return shortest(single);
  } else if (file.single && (written.text || static_cast<double>(single) == coordinate)) {
    return shortest(single);
  }
  // Steps of LAS tell a decimal, by a product and a sum of doubles.
  if (is_las(c.input().format) && !written.text) {
    const double decimal = std::round(coordinate * file.per_unit) / file.per_unit;
    const double rounding = 0x1p-50 * (std::abs(coordinate) + std::abs(file.offset));
    if (std::abs(decimal - coordinate) <= rounding) return shortest(decimal);
  }
  return shortest(coordinate);
}

/// LAS holds decimals to the last digit where 32 bits do, floats to their precision, and other
/// coordinates by the finest steps that reach, which is said.
void expect_las_steps(const Case& c, const TestCloud& cloud, const std::vector<Place>& truth,
                      const WrittenPoints& written, const std::string& errors) {
  double reach = 0;
  for (const Place& p : truth) {
    reach = std::max({reach, std::abs(p[0]), std::abs(p[1]), std::abs(p[2])});
  }
  for (std::size_t axis = 0; axis < 3; ++axis) {
    const double scale = written.scale[axis];
    const double offset = written.offset[axis];
    double worst = 0;
    double least = truth[0][axis];
    double most = least;
    for (const Place& p : truth) {
      const double read = std::round((p[axis] - offset) / scale) * scale + offset;
      worst = std::max(worst, std::abs(read - p[axis]));
      least = std::min(least, p[axis]);
      most = std::max(most, p[axis]);
    }
    if (is_las(c.input().format)) {
      EXPECT_EQ(scale, 1 / cloud.file.per_unit);
      EXPECT_EQ(offset, cloud.file.offset);
    }
    const double rounding = 0x1p-50 * (reach + std::abs(offset));
    if (worst <= rounding + (cloud.file.single ? reach * 0x1p-24 : 0)) continue;
    EXPECT_LE(worst, scale * 0.5000001 + rounding);
    EXPECT_TRUE(contains(errors, "rounded to steps")) << errors;
    if (!is_las(c.input().format)) {
      EXPECT_LE(scale, 20 * (most - least) / 4294967296.0);
    }
  }
}

/// Compares the coordinates that a file holds with those that it should hold.
void expect_values(const Case& c, const TestCloud& cloud, const std::vector<Place>& truth,
                   const WrittenPoints& written) {
  const auto triples_of = [&](const std::vector<Place>& places, bool found) {
    Triples triples;
    for (const Place& p : places) {
      if (!TestCloud::finite(p)) continue;
      std::string words;
      for (std::size_t axis = 0; axis < 3; ++axis) {
        words += word_of(p[axis], found, axis, c, cloud.file, written) + ' ';
      }
      ++triples[words];
    }
    return triples;
  };
  const Triples expected = triples_of(truth, false);
  const Triples found = triples_of(written.places, true);
  std::size_t lost = 0;
  std::string example;
  for (const auto& [words, times] : expected) {
    if (found.contains(words)) continue;
    ++lost;
    const auto near = found.lower_bound(words);
    if (example.empty()) example = words + "became " + (near == found.end() ? "?" : near->first);
  }
  std::size_t added = 0;
  for (const auto& [words, times] : found) added += expected.contains(words) ? 0 : 1;
  const Keeps keeps = c.command().keeps;
  if (keeps == Keeps::kMost) lost = lost > truth.size() / 3 ? lost : 0;
  EXPECT_EQ(lost, 0U) << "of " << expected.size() << " triples; " << example;
  if (keeps != Keeps::kFirstFile) {
    EXPECT_EQ(added, 0U) << "of " << found.size() << " triples";
  }
  const bool copies = std::string(c.command().name) == "GroupCopies";
  if (keeps != Keeps::kMost && keeps != Keeps::kFirstFile && !copies) {
    const auto count = static_cast<std::size_t>(
        std::count_if(written.places.begin(), written.places.end(), TestCloud::finite));
    EXPECT_EQ(count, truth.size());
  }
  EXPECT_FALSE(written.too_long);
}
void PassesThrough::check(const Case& c) {
  const TestCloud cloud(c, c.values(), c.beside());
  const PointFileMaker maker(cloud.file, c.input().format);
  const std::string in = folder_ / c.input().name;
  const std::string out = folder_ / c.output();
  write_text(in, maker.file());
  // A second file has the columns of the first, or none of surfels, and all digits.
  const TestCloud other(c, Values::kDoubles, Beside::kNothing);
  const bool columns = has_columns(c.input().format);
  const std::string second = folder_ / (columns ? "second.csv" : "second.ptx");
  write_text(second,
             PointFileMaker(other.file, columns ? PointFormat::kCsv : PointFormat::kPtx).file());
  Words command;
  std::istringstream words(c.command().line);
  for (std::string word; words >> word;) {
    const std::map<std::string, std::string> stands{
        {"IN", in},
        {"OUT", out},
        {"OTHER", second},
        {"BOX", cloud.box()},
        {"NAMES", kBareColumns},
        {"COUNT", std::to_string(cloud.file.places.size())},
        {"picture.png", folder_ / "picture.png"}};
    const auto found = stands.find(word);
    command.push_back(command.empty() ? tool(word) : found != stands.end() ? found->second : word);
    if (word == "--bounds") command.back() += "=" + cloud.box();
    if (word == "BOX") command.pop_back();
  }
  const bool pipe = contains(c.command().line, " - ");
  std::filesystem::remove(out);
  const RunResult result = run(command, {.input = pipe ? in : ""});
  if (pipe) write_text(out, result.output);
  const std::string what = fmt::format(
      "{} {} {}, {}, moved by {}, beside {}\n{}\n{}", c.command().name, c.input().name, c.output(),
      std::array{"millimetres", "products", "survey", "doubles", "floats"}[c.of[Case::kValue]],
      c.move(), std::array{"nothing", "a stray", "strays", "NaN", "unfit"}[c.of[Case::kBeside]],
      fmt::join(command, " "), result.errors.substr(0, 400));

  // LAS has no word for what is not a number.
  if (c.beside() == Beside::kNotANumber && is_las_name(c.output()) && result.exit_code == 1) {
    EXPECT_TRUE(contains(result.errors, "not finite")) << what;
    return;
  }
  ASSERT_EQ(result.exit_code, 0) << what;
  const WrittenPoints written = PointFileReader(out, read_text(out)).points();
  std::vector<Place> truth;
  std::size_t row = 0;
  for (std::size_t i = 0; i < cloud.file.places.size(); ++i) {
    Place p = cloud.file.places[i];
    // What scanners write where they have measured nothing.
    if (c.input().format == PointFormat::kPtx && p == Place{}) continue;
    if (c.command().keeps == Keeps::kEverySecond && row++ % 2 == 1) continue;
    if (c.command().keeps == Keeps::kInBox && !cloud.in_box(p)) continue;
    if (!TestCloud::finite(p)) continue;
    // Text has the decimals that LAS' steps mean.
    for (std::size_t axis = 0; axis < 3; ++axis) {
      if (!written.text || !is_las(c.input().format)) p[axis] = maker.told(i, axis);
    }
    truth.push_back(p);
  }
  if (contains(c.command().line, "OTHER") && c.command().keeps != Keeps::kFirstFile) {
    truth.insert(truth.end(), other.file.places.begin(), other.file.places.end());
  }
  SCOPED_TRACE(what);
  expect_values(c, cloud, truth, written);
  if (is_las_name(c.output())) expect_las_steps(c, cloud, truth, written, result.errors);
}

TEST_P(PassesThrough, AnyFormat) {
  static const std::vector<Case> cases = chosen_cases();
  int possible = 0;  // Both counts are for docs/reliability.md: --gtest_output=xml shows them.
  for_all_cases([&](const Case& c) { possible += c.of[Case::kCommand] == GetParam() ? 1 : 0; });
  RecordProperty("possible", possible);
  int runs = 0;
  for (const Case& c : cases) {
    if (c.of[Case::kCommand] != GetParam()) continue;
    check(c);
    ++runs;
  }
  RecordProperty("runs", runs);
  EXPECT_GT(runs, 0);
}

INSTANTIATE_TEST_SUITE_P(Tools, PassesThrough, testing::Range<std::size_t>(0, kCommandCount),
                         [](const auto& of) { return kCommands[of.param].name; });

/// Surfels of a cloud, and pictures that its strays are not in, are the same bytes beside these.
TEST(StrayPoints, ChangeNoSurfelAndNoPicture) {
  const TemporaryFolder folder;
  const std::string surfels = folder / "s.ply";
  const std::string picture = folder / "p.png";
  for (const std::size_t move : {1, 2, 3}) {
    for (const std::size_t input : {3, 10}) {
      Case c;
      c.of[Case::kMove] = move;
      c.of[Case::kInput] = input;
      const bool steps = has_steps(c.input().format);
      const std::string points = folder / c.input().name;
      std::vector<std::string> rows;
      std::vector<std::string> pictures;
      for (const Beside beside : {Beside::kNothing, Beside::kStray, Beside::kStrays}) {
        const TestCloud cloud(c, steps ? Values::kMillimetres : Values::kDoubles, beside);
        write_text(points, PointFileMaker(cloud.file, c.input().format).file());
        const std::string what =
            fmt::format("{}, moved by {}, {} points", points, c.move(), cloud.file.places.size());
        EXPECT_EQ(run({tool("surfel-estimate"), points, "-o", surfels}).exit_code, 0) << what;
        const std::string file = read_text(surfels);
        rows.push_back(file.substr(file.find("end_header\n") + 11));
        EXPECT_TRUE(rows.back().ends_with(rows.front())) << what;
        for (const std::string& shown : {points, surfels}) {
          const double x = c.move() + 10;
          const double z = c.move() / 10;
          EXPECT_EQ(run({tool("surfel-render"), shown, "-o", picture, "--size", "48x48",
                         fmt::format("--eye={},{},{}", x, 20 - x, z + 30),
                         fmt::format("--target={},{},{}", x, 20 - x, z)})
                        .exit_code,
                    0)
              << what;
          pictures.push_back(read_text(picture));
          EXPECT_TRUE(pictures.back() == pictures[(pictures.size() - 1) % 2]) << shown << what;
        }
      }
    }
  }
}

}  // namespace
}  // namespace surfel::test
