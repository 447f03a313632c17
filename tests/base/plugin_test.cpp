#include <string>

#include <dlfcn.h>
#include <gtest/gtest.h>
#include <surfel/base/error.h>
#include <surfel/base/plugin.h>

#include "support/message_of.h"

namespace surfel {
namespace {

const std::string kFolder = SURFEL_FAKE_PLUGIN_DIR;

TEST(Plugin, OfTheSameInterfaceIsOpened) {
  void* handle = open_plugin(kFolder + "/libfake_plugin_same.so");
  EXPECT_NE(dlsym(handle, "fake_plugin_answer"), nullptr);
}

TEST(Plugin, OfAnotherInterfaceIsRefused) {
  const std::string path = kFolder + "/libfake_plugin_other.so";
  const std::string message = test::message_of([&] { open_plugin(path); });
  EXPECT_EQ(message.rfind(path, 0), 0U) << message;
  EXPECT_NE(message.find("another version of Surfelkit"), std::string::npos) << message;
  // What is refused does not stay loaded.
  EXPECT_EQ(dlopen(path.c_str(), RTLD_NOW | RTLD_NOLOAD), nullptr);
}

TEST(Plugin, WithoutANumberIsRefused) {
  const std::string path = kFolder + "/libfake_plugin_none.so";
  const std::string message = test::message_of([&] { open_plugin(path); });
  EXPECT_NE(message.find("interface 0"), std::string::npos) << message;
}

TEST(Plugin, ThatIsMissingOrLacksAFunctionIsAnErrorThatNamesIt) {
  EXPECT_NE(test::message_of([] { plugin_symbol("nowhere", "f"); })
                .find("libsurfel_nowhere.so: is missing; install the package "
                      "libsurfel0-plugin-nowhere, or build"),
            std::string::npos);
  EXPECT_FALSE(has_plugin("nowhere"));
  EXPECT_TRUE(has_plugin("image"));
  EXPECT_NE(test::message_of([] { plugin_symbol("image", "nothing"); }).find("libsurfel_image.so"),
            std::string::npos);
}

}  // namespace
}  // namespace surfel
