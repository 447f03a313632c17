#include "tools/support/run_ranks.h"

#include <memory>

namespace surfel::tool {

int run_ranks(Tool& tool, int argc, char** argv, FunctionRef<void(Ranks* ranks)> body) {
  if (started_rank().rank > 0) tool.follow();
  std::unique_ptr<Ranks> ranks;
  const int code = tool.run(argc, argv, [&] {
    ranks = Ranks::join();
    body(ranks.get());
  });
  // The other processes wait for this one.
  if (code != kDone && ranks) ranks->abort(code);
  return code;
}

}  // namespace surfel::tool
