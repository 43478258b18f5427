// Files that block on opening or never end.
#include <filesystem>
#include <fstream>
#include <functional>

#include <gtest/gtest.h>
#include <sys/stat.h>

#include "helix_arm/io/data_set.hpp"
#include "helix_arm/io/tag_table.hpp"
#include "io/data/tip_path_file.hpp"
#include "io/document/atomic_file.hpp"
#include "procedures/captures.hpp"
#include "procedures/response_series.hpp"
#include "scene_faults.hpp"
#include "support/temporary_folder.hpp"

namespace helix_arm::io {
namespace {

using namespace test;

using Reader = std::function<void(const std::string& path)>;

// A scene whose regulator has its profile in another file.
void loadProfile(const std::string& path) {
  const TemporaryFolder folder;
  std::filesystem::create_symlink(path, folder / "profile.yaml");
  const std::string regulator =
      "  simulated: {time_constant_s: 0.2, supply_kpa: 450, noise_kpa: 2, seed: 7}";
  std::ofstream(folder / "arm.yaml") << replaced(
      kSpatialScene, regulator,
      "  ascii_serial: {profile: ./profile.yaml, device: /dev/ttyUSB0, addresses: [a, b, c, d, e, "
      "f]}");
  loadScene(folder / "arm.yaml");
}

// All functions that take the path of a file.
std::vector<Reader> readers() {
  static const Scene scene = sceneOf(kSpatialScene);
  return {
      [](const std::string& path) { loadScene(path); },
      [](const std::string& path) { sceneText(path); },
      [](const std::string& path) {
        sceneText(path, {{"name", "other"}});
      },
      loadProfile,
      [](const std::string& path) { procedures::kindOf(loadDataSet(path)); },
      [](const std::string& path) { pressuresOf(loadDataSet(path), 3); },
      [](const std::string& path) { procedures::lengthSeriesOf(loadDataSet(path)); },
      [](const std::string& path) { procedures::tipSeriesOf(loadDataSet(path), 3); },
      [](const std::string& path) { loadTagPoses(loadDataSet(path), 3, lie::SE3()); },
      [](const std::string& path) { loadTagCorners(loadDataSet(path), 3); },
      [](const std::string& path) { loadTipPath(loadDataSet(path)); },
      [](const std::string& path) { procedures::loadCaptures(scene, loadDataSet(path)); },
  };
}

std::string messageOf(const Reader& reader, const std::string& path) {
  try {
    reader(path);
  } catch (const std::runtime_error& error) {
    return error.what();
  }
  return {};
}

TEST(HostileFiles, NoReaderWaitsForAFifoOrADevice) {
  const TemporaryFolder folder;
  const std::string fifo = folder / "fifo";
  ASSERT_EQ(mkfifo(fifo.c_str(), 0600), 0);
  std::vector<Reader> all = readers();
  all.push_back([](const std::string& path) { sha256OfFile(path); });
  for (std::size_t i = 0; i < all.size(); ++i) {
    EXPECT_TRUE(has(messageOf(all[i], fifo), "is a FIFO; expected a regular file")) << i;
    EXPECT_TRUE(has(messageOf(all[i], "/dev/zero"), "is a device; expected a regular file")) << i;
  }
}

}  // namespace
}  // namespace helix_arm::io
