#include <gtest/gtest.h>
#include <surfel/base/error.h>
#include <surfel/chart/tool_chain.h>

namespace surfel {
namespace {

using Words = std::vector<std::string>;

TEST(ToolChain, TakesChanges) {
  ToolChain chain;
  chain.apply("surfel-render --cutoff 2 --frame-all --from=-1,0,0; surfel-estimate -k 8;");
  EXPECT_TRUE(chain.runs(Stage::kRender));
  EXPECT_TRUE(chain.runs(Stage::kEstimate));
  EXPECT_FALSE(chain.runs(Stage::kGroup));
  EXPECT_EQ(words_of(chain.options(Stage::kRender)),
            (Words{"--cutoff", "2", "--frame-all", "--from=-1,0,0"}));
  EXPECT_EQ(words_of(chain.options(Stage::kEstimate)), (Words{"-k", "8"}));
  chain.apply("surfel-render --cutoff 4");
  EXPECT_EQ(*chain.value(Stage::kRender, "--cutoff"), "4");
  EXPECT_EQ(chain.options(Stage::kRender).size(), 3U);
  EXPECT_EQ(chain.value(Stage::kRender, "--layers"), nullptr);
}

TEST(ToolChain, TakesBackOptionsButNotTools) {
  ToolChain chain;
  chain.apply("surfel-render --cutoff 2 --layers 8");
  chain.remove_options("surfel-render --cutoff 9; surfel-group --groups 4");
  EXPECT_EQ(words_of(chain.options(Stage::kRender)), (Words{"--layers", "8"}));
  EXPECT_FALSE(chain.runs(Stage::kGroup));
}

TEST(ToolChain, RefusesWhatIsNoChange) {
  for (const char* changes :
       {"surfel-paint --cutoff 2", "surfel-render 2", "--cutoff 2", "surfel-render --cutoff 2 3"}) {
    ToolChain chain;
    EXPECT_THROW(chain.apply(changes), Error) << changes;
  }
}

TEST(PreparingCommands, LeadFromTheInputToWhatIsRendered) {
  ToolChain chain;
  chain.apply("surfel-render --cutoff 2");
  EXPECT_TRUE(preparing_commands(chain, "a.ply").empty());
  chain.apply("surfel-group --groups 4; surfel-from-mesh --count 100");
  const auto commands = preparing_commands(chain, "a b.obj");
  ASSERT_EQ(commands.size(), 2U);
  EXPECT_EQ(commands[0].words,
            (Words{"surfel-from-mesh", "a b.obj", "--count", "100", "-o", commands[0].output}));
  EXPECT_EQ(commands[1].words,
            (Words{"surfel-group", commands[0].output, "--groups", "4", "-o", commands[1].output}));
}

TEST(PreparingCommands, ShareFilesAsFarAsTheyAreTheSame) {
  ToolChain a;
  a.apply("surfel-from-mesh --count 100; surfel-texture --fit ewa");
  ToolChain b = a;
  b.apply("surfel-texture --fit render");
  const auto of_a = preparing_commands(a, "m.obj");
  const auto of_b = preparing_commands(b, "m.obj");
  EXPECT_EQ(of_a[0].output, of_b[0].output);
  EXPECT_NE(of_a[1].output, of_b[1].output);
  EXPECT_NE(of_a[0].output, preparing_commands(a, "n.obj")[0].output);
  // What comes after the surfels does not matter to them.
  b = a;
  b.apply("surfel-render --cutoff 3");
  EXPECT_EQ(preparing_commands(b, "m.obj")[1].output, of_a[1].output);
}

TEST(TextHash, IsFnv1a) {
  EXPECT_EQ(text_hash(""), "cbf29ce484222325");
  EXPECT_EQ(text_hash("a"), "af63dc4c8601ec8c");
  EXPECT_EQ(text_hash("foobar"), "85944171f73967e8");
}

}  // namespace
}  // namespace surfel
