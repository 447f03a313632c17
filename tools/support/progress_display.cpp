#include "tools/support/progress_display.h"

#include <algorithm>
#include <chrono>
#include <cmath>
#include <system_error>

#include <fmt/format.h>
#include <sys/ioctl.h>
#include <unistd.h>

#include "tools/support/json.h"
#include "tools/support/standard_error.h"

namespace surfel::tool {
namespace {

constexpr std::chrono::milliseconds kBetween{100};
/// What is done sooner than this needs no line.
constexpr double kFirstMilliseconds = 1000;

/// "4.2 M points", "12 MB".
std::string amount(double count, const std::string& unit) {
  const bool bytes = unit == "B";
  const std::string text = scaled_count(count);
  const bool prefixed = text.find(' ') != std::string::npos;
  return text + (bytes ? (prefixed ? "B" : " B") : " " + unit);
}

/// "1.3 M/s", of bytes "12 MB/s".
std::string rate_text(double rate, const std::string& unit) {
  return (unit == "B" ? amount(rate, unit) : scaled_count(rate)) + "/s";
}

/// "0:04" of 4 seconds.
std::string minutes(double seconds) {
  const auto whole = static_cast<long>(std::ceil(seconds));
  return fmt::format("{}:{:02}", whole / 60, whole % 60);
}

std::size_t terminal_width() {
  constexpr std::size_t kUsual = 80;
  struct winsize size {};
  const bool known = ioctl(STDERR_FILENO, TIOCGWINSZ, &size) == 0 && size.ws_col > 0;
  return known ? size.ws_col : kUsual;
}

/// The rate of a stage, units a second, and the seconds that are left; negative where unknown.
struct Pace {
  double rate;
  double left;
};

Pace pace_of(const ProgressStage& stage, double milliseconds) {
  const auto done = static_cast<double>(stage.done());
  const double rate = milliseconds > 0 ? done / milliseconds * 1000 : 0;
  const double rest = std::max(0.0, static_cast<double>(stage.total()) - done);
  return {rate, rate > 0 ? rest / rate : -1};
}

}  // namespace

std::string scaled_count(double count) {
  for (const auto& [size, prefix] : {std::pair{1e9, "G"}, {1e6, "M"}, {1e3, "k"}}) {
    // What rounds to 1000 of a prefix is 1 of the next.
    if (count < 0.9995 * size) continue;
    const double scaled = count / size;
    return fmt::format("{:.{}f} {}", scaled, scaled < 9.95 ? 1 : 0, prefix);
  }
  return fmt::format("{:.0f}", count);
}

ProgressDisplay::~ProgressDisplay() { stop(); }

void ProgressDisplay::start(ProgressStyle style) {
  style_ = style;
  if (style == ProgressStyle::kNone) return;
  since_start_.restart();
  try {
    thread_ = std::thread([this] { run(); });
  } catch (const std::system_error&) {
    style_ = ProgressStyle::kNone;  // The work goes on where no thread can be started to show it.
    return;
  }
  set_progress_observer(this);
}

void ProgressDisplay::stop() noexcept {
  if (!thread_.joinable()) return;
  set_progress_observer(nullptr);
  {
    const std::lock_guard guard(mutex_);
    stopping_ = true;
  }
  wake_.notify_all();
  thread_.join();
  erase();
}

std::unique_lock<std::mutex> ProgressDisplay::lock() {
  std::unique_lock guard(mutex_);
  erase();
  return guard;
}

void ProgressDisplay::begin(const ProgressStage& stage) {
  const std::lock_guard guard(mutex_);
  running_.push_back({&stage, Timer()});
  if (style_ == ProgressStyle::kJson) show_json(running_.back(), "begin");
}

void ProgressDisplay::end(const ProgressStage& stage) noexcept {
  const std::lock_guard guard(mutex_);
  const auto found = std::find_if(running_.begin(), running_.end(),
                                  [&](const Running& r) { return r.stage == &stage; });
  if (found == running_.end()) return;
  if (style_ == ProgressStyle::kJson) show_json(*found, "end");
  running_.erase(found);
}

void ProgressDisplay::run() {
  std::unique_lock guard(mutex_);
  while (!wake_.wait_for(guard, kBetween, [this] { return stopping_; })) {
    if (running_.empty()) {
      erase();
    } else if (style_ == ProgressStyle::kJson) {
      show_json(running_.back(), "progress");
    } else if (since_start_.milliseconds() >= kFirstMilliseconds) {
      show_line();
    }
  }
}

void ProgressDisplay::erase() {
  if (width_ == 0) return;
  tell(fmt::format("\r{:{}}\r", "", width_));
  width_ = 0;
}

void ProgressDisplay::show_line() {
  std::string line = printable(running_.front().stage->name());
  // Work that counts nothing itself is told by the stages within it.
  const auto counted = std::find_if(running_.begin(), running_.end(),
                                    [](const Running& r) { return r.stage->done() > 0; });
  if (counted != running_.end()) {
    const ProgressStage& stage = *counted->stage;
    const auto done = static_cast<double>(stage.done());
    const auto total = static_cast<double>(stage.total());
    const Pace pace = pace_of(stage, counted->timer.milliseconds());
    line += fmt::format("  {} of {}", scaled_count(done), amount(total, stage.unit()));
    if (total > 0) line += fmt::format("  {:.0f} %", std::min(100.0, 100 * done / total));
    line += "  " + rate_text(pace.rate, stage.unit());
    if (pace.left >= 0) line += fmt::format("  {} left", minutes(pace.left));
  }
  // A line that is broken by the terminal cannot be rewritten.
  line.resize(std::min(line.size(), terminal_width() - 1));
  tell(fmt::format("\r{:{}}", line, width_));
  width_ = std::max(width_, line.size());
}

void ProgressDisplay::show_json(const Running& running, const char* event) {
  const ProgressStage& stage = *running.stage;
  const Pace pace = pace_of(stage, running.timer.milliseconds());
  const Json line = {{"event", event},
                     {"stage", stage.name()},
                     {"done", stage.done()},
                     {"total", stage.total()},
                     {"unit", stage.unit()},
                     {"rate", pace.rate},
                     {"seconds_left", pace.left < 0 ? Json() : Json(pace.left)}};
  tell(line.dump(-1, Json::Members::kAsAdded) + "\n");
}

}  // namespace surfel::tool
