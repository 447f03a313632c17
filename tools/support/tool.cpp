#include "tools/support/tool.h"

#include <algorithm>
#include <atomic>
#include <csignal>
#include <cstdlib>
#include <cstring>
#include <filesystem>
#include <limits>
#include <new>
#include <optional>
#include <string_view>
#include <system_error>

#include <fmt/format.h>
#include <surfel/base/error.h>
#include <surfel/base/instructions.h>
#include <surfel/base/memory.h>
#include <surfel/base/output_file.h>
#include <surfel/base/parallel.h>
#include <surfel/base/shell_quote.h>
#include <surfel/base/standard_streams.h>
#include <surfel/base/version.h>
#include <surfel/io/image_io.h>
#include <surfel/io/named_file.h>
#include <unistd.h>

#include "tools/support/config_file.h"
#include "tools/support/option_pages.h"
#include "tools/support/progress_display.h"
#include "tools/support/standard_error.h"

namespace surfel::tool {
namespace {

std::atomic<bool> g_signalled{false};

/// The first signal asks the loops to stop, so that the run ends by its own error path. The second
/// ends the process at once, and so does the alarm, where the run did not come to a loop that asks.
extern "C" void handle_signal(int signal) {
  constexpr unsigned kPatience = 5;  ///< Seconds.
  if (!g_signalled.exchange(true)) {
    request_interrupt();
    alarm(kPatience);
    return;
  }
  remove_temporaries();
  // By the signal that a shell knows as asked for, not by an alarm.
  if (signal == SIGALRM) signal = SIGTERM;
  std::signal(signal, SIG_DFL);
  std::raise(signal);
}

void install_signal_handlers() {
  struct sigaction action {};
  action.sa_handler = handle_signal;
  action.sa_flags = SA_RESTART;
  sigemptyset(&action.sa_mask);
  for (const int signal : {SIGINT, SIGTERM, SIGHUP, SIGALRM}) sigaction(signal, &action, nullptr);
  // A closed pipe and a file past its size limit are then errors of write(), with a message.
  std::signal(SIGPIPE, SIG_IGN);
  std::signal(SIGXFSZ, SIG_IGN);
}

/// Colour and bars are for people: on a terminal that is not dumb.
bool interactive() {
  const char* terminal = std::getenv("TERM");
  return isatty(STDERR_FILENO) != 0 && terminal && std::string(terminal) != "dumb";
}

bool colored() {
  const char* no_color = std::getenv("NO_COLOR");
  return interactive() && !(no_color && *no_color);
}

/// For messages and header comments, which are one line.
std::string one_line(std::string text) {
  std::replace_if(
      text.begin(), text.end(), [](char c) { return c == '\n' || c == '\r' || c == '\t'; }, ' ');
  return printable(text);
}

constexpr const char* kOutOfMemory =
    "out of memory; use fewer surfels, a smaller picture, fewer --threads or a larger machine, or "
    "raise the limit (ulimit -v)";

/// How a run ended.
struct Outcome {
  ExitCode code = kDone;
  std::string message;
};

/// The variable of the environment that chooses the set of vector instructions.
constexpr const char* kInstructions = "SURFEL_INSTRUCTIONS";

void use_chosen_instructions() {
  const char* name = std::getenv(kInstructions);
  if (!name || !*name) return;
  try {
    set_instructions(name);
  } catch (const Error& error) {
    throw Error(error.kind(), fmt::format("{}: {}", kInstructions, error.what()));
  }
}

ExitCode exit_code(ErrorKind kind) { return kind == ErrorKind::kUsage ? kWrongUsage : kFailed; }

}  // namespace

struct Tool::Impl {
  Impl(std::string tool_name, const std::string& summary)
      : name(std::move(tool_name)), app(summary, name) {}

  std::string name;
  CommandLine app;
  FieldNames field_names;
  std::vector<std::string> everyday;
  std::vector<std::string> examples;
  RunFiles files{app};
  CommonOptions common;
  bool print_config = false;
  bool manual = false;
  std::optional<Shell> completion;
  std::uint64_t most_pixels = most_image_pixels();
  bool allow_outside = false;
  bool follows = false;  ///< See follow().
  Json report = Json::object();
  Timer total;

  ProgressDisplay display;

  void add_common_options();
  bool parse(int argc, char** argv);
  std::string answer(Asked asked);
  std::string everyday_help();
  void refuse_words(int argc, char** argv) const;
  void refuse_leftovers() const;
  void refuse_pairs() const;
  std::string of_inputs(const std::string& text) const;
  Outcome attempt(const std::function<void()>& action) const;
  void message(const std::string& text, const char* kind = "");
  void error(const std::string& text);
  ProgressStyle progress_style() const;
  void write_report(OutputFile& file, const Outcome& outcome);
};

void Tool::Impl::add_common_options() {
  app.add_standard_flags();
  const std::string group = "Common options";
  app.add_option("--threads", common.threads)
      ->range(1, kMostThreads)
      ->type_name("INT")
      ->default_str("")
      ->description(fmt::format("Threads, 1..{}; results do not depend on it (default: one a core)",
                                kMostThreads))
      ->group(group);
  app.add_config("--config", "TOML file of options under their long names; the command line wins",
                 [this](std::istream& in) { read_config(app, in); })
      ->type_name("FILE")
      ->configurable(false)
      ->group(group);
  app.add_flag("--print-config", print_config, "Print the settings in force as TOML and exit")
      ->configurable(false)
      ->group(group);
  app.add_flag("--manual", manual, "Print the manual page, for man, and exit")
      ->configurable(false)
      ->group(group);
  add_choice(app, "--completion", completion,
             {{"bash", Shell::kBash}, {"zsh", Shell::kZsh}, {"fish", Shell::kFish}},
             "Print the script that lets a shell complete options, and exit")
      ->configurable(false)
      ->group(group);
  app.add_flag("--quiet", common.quiet, "Print errors only")->group(group);
  app.add_flag("--verbose", common.verbose, "Print details")->group(group);
  add_choice(
      app, "--progress", common.progress,
      {{"auto", Progress::kAuto}, {"none", Progress::kNone}, {"json", Progress::kJson}},
      "Progress of what takes longer than a second, on standard error: a line where that is a "
      "terminal; none; or a JSON object a line, wherever it goes")
      ->group(group);
  app.add_flag("--no-clobber", common.no_clobber, "Never overwrite a file")->group(group);
  app.add_option("--stats", common.stats,
                 "JSON report to write: options, counts, times in ms, peak memory in bytes")
      ->type_name("FILE")
      ->group(group);
  files.reads({"--config"});
  files.writes("--stats", Writes::kReport);
}

/// The command line as CommandLine wants it, last word first. The values -x, -y and -z of --up,
/// which it would take for options, are joined to it.
std::vector<std::string> words_of(int argc, char** argv) {
  std::vector<std::string> words;
  for (int i = 1; i < argc; ++i) {
    const std::string word = argv[i];
    const bool axis = word == "-x" || word == "-y" || word == "-z";
    if (axis && !words.empty() && words.back() == "--up") {
      words.back() += "=" + word;
    } else {
      words.push_back(word);
    }
  }
  std::reverse(words.begin(), words.end());
  return words;
}

/// False if the run ends here: help, version or settings were printed.
bool Tool::Impl::parse(int argc, char** argv) {
  const bool only_printed = std::any_of(argv + std::min(argc, 1), argv + argc, [](const char* a) {
    const std::string_view word = a;
    return word == "--print-config" || word == "--manual" || word.starts_with("--completion");
  });
  if (only_printed) {
    for (Option* option : app.options()) option->required(false);
  }
  check_numbers(app);
  refuse_words(argc, argv);
  try {
    if (const Asked asked = app.parse(words_of(argc, argv)); asked != Asked::kRun) {
      print(answer(asked));
      return false;
    }
  } catch (const OptionError&) {
    // What CommandLine says of missing and contradictory options is of no use where one was
    // misspelt.
    refuse_leftovers();
    refuse_pairs();
    throw;
  }
  if (print_config) print(config_text(app));
  if (manual) print(manual_page(app, {name, version(), examples}));
  if (completion) print(completion_script(app, name, *completion));
  return !print_config && !manual && !completion;
}

/// What the tool prints instead of running.
std::string Tool::Impl::answer(Asked asked) {
  if (asked == Asked::kVersion) return fmt::format("{} {}\n", name, version());
  return asked == Asked::kHelp ? everyday_help() : app.help();
}

/// The help with everyday options and examples alone.
std::string Tool::Impl::everyday_help() {
  if (everyday.empty()) return app.help();
  const auto shown = [&](const Option* option) {
    if (app.is_help(option)) return true;
    return std::any_of(everyday.begin(), everyday.end(),
                       [&](const std::string& other) { return app.get_option(other) == option; });
  };
  std::size_t options = 0;
  for (Option* option : app.options()) {
    if (option->is_positional()) continue;
    ++options;
    // The group without a name is not printed.
    option->group(shown(option) ? "Everyday options" : "");
  }
  app.footer(fmt::format("Examples:\n  {}\n\n{} --help-all prints all {} options.",
                         fmt::join(examples, "\n  "), name, options));
  return app.help();
}

/// A long option with one dash would be taken for short ones: "-output x" for "-o utput x".
void Tool::Impl::refuse_words(int argc, char** argv) const {
  for (int i = 1; i < argc && std::strcmp(argv[i], "--") != 0; ++i) {
    const std::string word = argv[i];
    if (word.size() < 3 || word[0] != '-' || word[1] == '-') continue;
    const std::string with_dashes = "-" + word.substr(0, word.find('='));
    if (app.find_option(with_dashes)) {
      throw_usage(fmt::format("{} has one dash too few; did you mean {}?", word, with_dashes));
    }
  }
}

/// Throws Error(kUsage) for what CommandLine took for neither options nor their values.
void Tool::Impl::refuse_leftovers() const {
  std::vector<std::string> unknown;
  std::vector<std::string> words;
  for (const std::string& word : app.remaining()) {
    if (word.size() < 2 || word[0] != '-') {
      words.push_back("'" + word + "'");
      continue;
    }
    const std::string option = word.substr(0, word.find('='));
    unknown.push_back(
        fmt::format("{} is not an option{}", option, did_you_mean(option, typed_names(app))));
  }
  require_valid(unknown);
  if (words.empty()) return;
  throw_usage(fmt::format("{} {} not expected; names with blanks need quotes",
                          fmt::join(words, " "), words.size() > 1 ? "are" : "is"));
}

/// Throws Error(kUsage) for the first two options that exclude one another.
void Tool::Impl::refuse_pairs() const {
  const std::vector<Option*> order = app.parse_order();
  for (std::size_t second = 1; second < order.size(); ++second) {
    for (std::size_t first = 0; first < second; ++first) {
      const Option* const a = order[first];
      const Option* const b = order[second];
      if (!a->excluded_by(b)) continue;
      throw_usage(fmt::format("{} and {} do not go together; leave one out", a->name(), b->name()));
    }
  }
}

/// The message after the names of the files that the run reads: errors of the standard library do
/// not know the file that they came from.
std::string Tool::Impl::of_inputs(const std::string& text) const {
  const std::vector<std::string> inputs = files.inputs();
  if (inputs.empty()) return text;
  return fmt::format("{}: {}", fmt::join(inputs, ", "), text);
}

Outcome Tool::Impl::attempt(const std::function<void()>& action) const {
  try {
    action();
    return {};
  } catch (const Error& error) {
    return {exit_code(error.kind()), with_option_names(error.what(), app, field_names)};
  } catch (const OptionError& error) {
    return {kWrongUsage, error.what()};
  } catch (const std::bad_alloc&) {
    return {kFailed, of_inputs(kOutOfMemory)};
  } catch (const std::length_error&) {
    return {kFailed, of_inputs(kOutOfMemory)};
  } catch (const std::system_error& error) {
    const bool refused = error.code() == std::errc::resource_unavailable_try_again;
    const char* advice =
        refused ? "no thread can be started: use fewer --threads or raise the limits (ulimit -u, "
                  "-v)"
                : "surfel-info tells whether a file is sound";
    return {kFailed, of_inputs(fmt::format("{}; {}", error.what(), advice))};
  } catch (const std::exception& error) {
    return {kFailed,
            of_inputs(fmt::format("{}; surfel-info tells whether a file is sound", error.what()))};
  }
}

/// A line that is rewritten is for people at a terminal; lines of JSON are for programs anywhere.
ProgressStyle Tool::Impl::progress_style() const {
  if (common.quiet) return ProgressStyle::kNone;
  if (common.progress == Progress::kJson) return ProgressStyle::kJson;
  return common.progress == Progress::kAuto && interactive() ? ProgressStyle::kLine
                                                             : ProgressStyle::kNone;
}

void Tool::Impl::message(const std::string& text, const char* kind) {
  const auto lock = display.lock();
  tell(fmt::format("{}: {}{}\n", name, kind, one_line(text)));
}

void Tool::Impl::error(const std::string& text) {
  message(text, colored() ? "\033[31merror:\033[0m " : "error: ");
}

void Tool::Impl::write_report(OutputFile& file, const Outcome& outcome) {
  static const std::vector<std::string> kPrinting = {"help",         "help-all", "version",
                                                     "print-config", "manual",   "completion"};
  Json options = Json::object();
  for (const Option* option : app.options()) {
    if (std::count(kPrinting.begin(), kPrinting.end(), plain_name(*option)) > 0) continue;
    Json value = value_in_force(*option);
    if (!value.is_null()) options[plain_name(*option)] = std::move(value);
  }
  report["tool"] = name;
  report["version"] = version();
  report["options"] = std::move(options);
  report["threads"] = thread_count();
  report["instructions"] = instructions();
  report["total_ms"] = total.milliseconds();
  report["peak_memory_bytes"] = peak_memory_bytes();
  if (outcome.code != kDone) report["error"] = outcome.message;
  file.write(report.dump(2) + "\n");
  file.commit();
}

Tool::Tool(std::string name, const std::string& summary)
    : impl_(std::make_unique<Impl>(std::move(name), summary)) {
  hold_standard_descriptors();
  impl_->add_common_options();
}

Tool::~Tool() = default;

CommandLine& Tool::app() { return impl_->app; }
void Tool::name_fields(FieldNames names) { impl_->field_names = std::move(names); }
RunFiles& Tool::files() { return impl_->files; }
void Tool::everyday(std::vector<std::string> options, std::vector<std::string> examples) {
  impl_->everyday = std::move(options);
  impl_->examples = std::move(examples);
}

void Tool::reads_images() {
  impl_->app
      .add_option(
          "--max-pixels", impl_->most_pixels,
          "Pixels that an image may have to be read, >= 1: what a header claims takes memory")
      ->range(std::uint64_t{1}, std::numeric_limits<std::uint64_t>::max())
      ->type_name("UINT")
      ->group("Common options");
}

void Tool::reads_named_files() {
  impl_->app
      .add_flag("--allow-outside", impl_->allow_outside,
                "Read files outside of a file's folder that the file names: images, values of "
                "volumes")
      ->group("Common options");
}

const CommonOptions& Tool::common() const { return impl_->common; }
Json& Tool::report() { return impl_->report; }

void Tool::note(const std::string& message) const {
  if (impl_->common.quiet) return;
  impl_->message(with_option_names(message, impl_->app, impl_->field_names));
}

void Tool::detail(const std::string& message) const {
  if (impl_->common.verbose && !impl_->common.quiet) impl_->message(message);
}

void Tool::wrote(const std::string& path, const std::string& what,
                 const std::vector<std::string>& files) const {
  std::uintmax_t bytes = 0;
  for (const std::string& file : files.empty() ? std::vector{path} : files) {
    std::error_code none;
    const std::uintmax_t size = std::filesystem::file_size(file, none);
    if (!none) bytes += size;
  }
  const std::string scaled = scaled_count(static_cast<double>(bytes));
  const bool prefixed = scaled.find(' ') != std::string::npos;
  note(fmt::format("{}: {}, {}in {:.1f} s", path == "-" ? "standard output" : path, what,
                   bytes > 0 ? scaled + (prefixed ? "B, " : " B, ") : "",
                   impl_->total.milliseconds() / 1000));
}

std::string Tool::provenance() const {
  std::string line = fmt::format("{} {}", impl_->name, version());
  for (const Option* option : impl_->app.options()) {
    const std::string name = plain_name(*option);
    static const std::vector<std::string> kWithoutEffect = {
        "threads",  "memory",        "config", "quiet",      "verbose",
        "progress", "no-clobber",    "stats",  "max-pixels", "output",
        "tiles",    "skip-existing", "frames", "resume",     "explain-pixel"};
    if (option->count() == 0 ||
        std::count(kWithoutEffect.begin(), kWithoutEffect.end(), name) > 0) {
      continue;
    }
    if (!option->long_names().empty()) line += " --" + name;
    if (option->is_flag()) continue;
    const bool file = option->long_names().empty();
    for (const std::string& value : option->results()) {
      const std::string plain = value.substr(value.rfind('/') + 1);
      line += " " + (file ? shell_file(plain) : shell_quoted(plain));
    }
  }
  return one_line(line);
}

std::string Tool::options_given(const std::vector<std::string>& without) const {
  std::string text;
  for (const Option* option : impl_->app.options()) {
    const std::string name = plain_name(*option);
    if (option->count() == 0 || option->long_names().empty() ||
        std::count(without.begin(), without.end(), name) > 0) {
      continue;
    }
    if (option->is_flag()) text += " --" + name;
    if (option->is_flag()) continue;
    // With "=", as a value may begin with a minus.
    for (const std::string& value : option->results()) {
      text += " --" + name + "=" + shell_quoted(value);
    }
  }
  return text;
}

void Tool::follow() { impl_->follows = true; }

int Tool::run(int argc, char** argv, const std::function<void()>& body) {
  impl_->total.restart();
  install_signal_handlers();
  bool proceed = false;
  Outcome outcome = impl_->attempt([&] {
    use_chosen_instructions();
    proceed = impl_->parse(argc, argv);
  });
  if (impl_->follows) {
    impl_->common.quiet = true;
    impl_->common.stats.clear();
  }
  if (outcome.code == kWrongUsage) {
    // What asks what was meant needs no further advice.
    const bool asks = outcome.message.ends_with('?');
    impl_->error(outcome.message + (asks ? "" : "; see " + impl_->name + " --help"));
    return outcome.code;
  }
  std::optional<OutputFile> stats;
  if (proceed) {
    outcome = impl_->attempt([&] {
      set_thread_count(impl_->common.threads);  // Plug-ins that the check loads see to it.
      impl_->files.check();
      set_most_image_pixels(impl_->most_pixels);
      allow_outside(impl_->allow_outside);
      // Opened first: a report that cannot be written is found before the work, not after.
      if (!impl_->common.stats.empty()) {
        stats.emplace(impl_->common.stats, impl_->common.no_clobber);
      }
      impl_->display.start(impl_->progress_style());
      body();
    });
    impl_->display.stop();
  }
  if (stats) {
    const Outcome reported = impl_->attempt([&] { impl_->write_report(*stats, outcome); });
    if (outcome.code == kDone) outcome = reported;
  }
  if (outcome.code != kDone) impl_->error(outcome.message);
  return outcome.code;
}

void print(const std::string& text) {
  require_standard_output();
  const std::string shown = printable(text);
  write_all(STDOUT_FILENO, shown.data(), shown.size(), "standard output");
}

void require_valid(const std::vector<std::string>& problems) {
  if (!problems.empty()) throw_usage(fmt::format("{}", fmt::join(problems, "; ")));
}

void append(std::vector<std::string>& problems, const std::vector<std::string>& more) {
  problems.insert(problems.end(), more.begin(), more.end());
}

void add_stages(Json& report, const StageTimes& times) {
  for (const auto& [stage, ms] : times.stages()) report["stages"][stage] = ms;
}

}  // namespace surfel::tool
