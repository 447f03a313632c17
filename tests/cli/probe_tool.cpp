// A tool that does nothing but what the tests of the common command line need: options of every
// kind, and failures on request.

#include <cstdint>
#include <fstream>
#include <new>
#include <stdexcept>

#include <surfel/base/error.h>
#include <surfel/base/output_file.h>
#include <surfel/base/parallel.h>
#include <surfel/base/progress.h>
#include <surfel/base/types.h>
#include <unistd.h>

#include "tools/support/options.h"
#include "tools/support/tool.h"

namespace {

enum class Ending { kDone, kUsage, kInput, kMemory, kSize, kException, kWait, kStuck };

/// Runs until it is interrupted.
void wait_for_interrupt() {
  for (;;) {
    surfel::parallel_for(100, 1, [](std::size_t, std::size_t, int) { usleep(1000); });
  }
}

/// Never ends, and makes a file once a first signal has come.
void stick(const std::string& file) {
  while (!surfel::interrupt_requested()) usleep(1000);
  std::ofstream(file).flush();
  for (;;) usleep(1000);
}

void end(Ending ending, const std::string& input) {
  switch (ending) {
    case Ending::kDone:
      return;
    case Ending::kUsage:
      return surfel::tool::require_valid({"first problem", "second problem"});
    case Ending::kInput:
      surfel::throw_input("scan.ply", "is made up; choose another ending");
    case Ending::kMemory:
      throw std::bad_alloc();
    case Ending::kSize:
      throw std::length_error("vector::_M_default_append");
    case Ending::kException:
      throw std::runtime_error("something else");
    case Ending::kWait:
      return wait_for_interrupt();
    case Ending::kStuck:
      return stick(input);
  }
}

}  // namespace

int main(int argc, char** argv) {
  surfel::tool::Tool tool("surfel-probe", "Tests the common command line.");
  std::string input;
  std::string output;
  double spacing = 0.01;
  int count = 7;
  std::uint64_t seed = 1;
  bool flat = false;
  surfel::Vec3d eye(0, 0, 3);
  std::optional<surfel::Vec3d> target;
  int width = 640;
  int height = 480;
  std::vector<double> lights;
  Ending ending = Ending::kDone;
  tool.app().add_option("input", input, "Input")->required();
  tool.app().add_option("-o,--output", output, "Output")->required();
  tool.files().reads({"input"});
  tool.app().add_option("--spacing", spacing, "Spacing, scene units");
  tool.app().add_option("--count", count, "Count");
  tool.app().add_option("--seed", seed, "Seed");
  tool.app().add_flag("--flat", flat, "Flat");
  surfel::tool::add_vector(tool.app(), "--eye", eye, "Eye, scene units");
  surfel::tool::add_vector(tool.app(), "--target", target, "Target, scene units");
  surfel::tool::add_size(tool.app(), "--size", width, height, "Size, pixels");
  tool.app().add_option("--light", lights, "Lights");
  surfel::tool::add_choice(tool.app(), "--ending", ending,
                           {{"done", Ending::kDone},
                            {"usage", Ending::kUsage},
                            {"input", Ending::kInput},
                            {"memory", Ending::kMemory},
                            {"size", Ending::kSize},
                            {"exception", Ending::kException},
                            {"wait", Ending::kWait},
                            {"stuck", Ending::kStuck}},
                           "How to end");
  return tool.run(argc, argv, [&] {
    surfel::OutputFile file(output, tool.common().no_clobber);
    tool.note("at work");
    tool.detail("in detail");
    surfel::ProgressStage stage("working", 10000000, "points");
    stage.add(4200000);
    tool.report()["eye"] = {eye.x(), eye.y(), eye.z()};
    tool.report()["size"] = {width, height};
    tool.report()["spacing"] = spacing;
    tool.report()["flat"] = flat;
    tool.report()["target"] = target.has_value();
    end(ending, input);
    file.write(tool.provenance() + "\n");
    file.commit();
  });
}
