// Scenes given by name.
#include <algorithm>
#include <filesystem>
#include <fstream>
#include <stdexcept>

#include <gtest/gtest.h>

#include "helix_arm/io/scene.hpp"
#include "helix_arm/io/shipped_files.hpp"
#include "support/has.hpp"
#include "support/refusal.hpp"
#include "support/temporary_folder.hpp"

namespace helix_arm::io {
namespace {

TEST(ScenePath, TheNameOfAShippedSceneIsItsFile) {
  const std::vector<std::string> names = shippedNames(kShippedScenes);
  EXPECT_TRUE(std::is_sorted(names.begin(), names.end()));
  for (const char* const name : {"demo", "helical_50", "spatial_101", "annotated"}) {
    EXPECT_TRUE(std::binary_search(names.begin(), names.end(), name)) << name;
    const std::string path = scenePath(name);
    EXPECT_TRUE(std::filesystem::is_regular_file(path)) << path;
    EXPECT_EQ(loadScene(path).name, name);
  }
}

TEST(ScenePath, AFileThatExistsComesFirst) {
  const test::TemporaryFolder folder;
  const auto before = std::filesystem::current_path();
  std::filesystem::current_path(std::filesystem::path(folder / "demo").parent_path());
  std::ofstream("demo") << "name: mine\n";
  const std::string found = scenePath("demo");
  std::filesystem::current_path(before);
  EXPECT_EQ(found, "demo");
}

TEST(ScenePath, PathsStayAsTheyAre) {
  for (const char* const path : {"/no/such.yaml", "no_such.yaml", "./demo", "folder/demo"}) {
    EXPECT_EQ(scenePath(path), path);
  }
}

TEST(ScenePath, AnUnknownNameIsRefusedWithTheShippedOnes) {
  const std::string message =
      test::refusal<std::invalid_argument>([] { static_cast<void>(scenePath("dem")); });
  EXPECT_EQ(message.find("the scene dem is neither a file nor a shipped scene"), 0u) << message;
  for (const std::string& name : shippedNames(kShippedScenes)) {
    EXPECT_TRUE(test::has(message, name));
  }
}

}  // namespace
}  // namespace helix_arm::io
