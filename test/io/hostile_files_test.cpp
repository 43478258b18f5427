// Files that must not be read, that block on opening, or that consume memory.
#include <filesystem>
#include <fstream>
#include <functional>
#include <iostream>

#include <gtest/gtest.h>
#include <sys/stat.h>

#include "helix_arm/io/atomic_file.hpp"
#include "helix_arm/io/data_set.hpp"
#include "helix_arm/io/tag_table.hpp"
#include "helix_arm/io/tip_path_file.hpp"
#include "helix_arm/procedures/captures.hpp"
#include "helix_arm/procedures/response_series.hpp"
#include "scene_faults.hpp"
#include "support/bounded_child.hpp"
#include "support/random.hpp"
#include "support/temporary_folder.hpp"
#include "support/test_size.hpp"

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

// ---- Content of foreign files -------------------------------------------------------------------

// A word that must not appear in any message.
std::string secret(Random& random) {
  std::string word = "Q";
  for (int i = 0; i < 9; ++i) word += "0123456789XZ"[random.integer(0, 11)];
  return word;
}

// Files of other people, each @ a secret word.
const char* const kForeign[] = {
    "root:$6$@$@:19000:0:99999:7:::\ndaemon:*:19000:0:99999:7:::\n@:!:19000::::::\n",
    "root:x:0:0:@:/root:/bin/@\n",
    "machine @ login @ password @\n",
    "-----BEGIN OPENSSH PRIVATE KEY-----\n@@@@@@@@\n@@@\n-----END OPENSSH PRIVATE KEY-----\n",
    "@: @\n",
    "name: @\n@: {@: @, @: [@, @]}\n",
    "name: @\nsafety: {@: @}\ntags: [@, @]\ncamera: @\n",
    "[@, @, {@: @}]\n",
    "? [@, @]\n: @\n",
    "@: 1\n@: 1\n\"@\": 2\n",
    "a: &@ 1\nb: *@\nc: *Q@\n",
    "a: \"\\@\"\n",
    "a: \"\\uZZ@\"\n",
    "%YAML @\n---\na: @\n",
    "!@!@ b: @\n",
    "'@\n",
    "{@: @\n",
    "@: @\n---\n@: @\n",
    "\"@\"\n",
    "@,@,@\n@,@,@\n1,@,2\n",
    "@\n@\n",
    "@,@\n1,2\n3,4\n",
    "@,@\n1\n1,2,3\n",
    "capture,tag,@\n@,@,@\n",
    "x_m,curvature_rad,@\n@,@,@\n",
    "user,password\n@,@\n",
    "export TOKEN=@\nexport KEY='@'\n",
};

TEST(HostileFiles, NoMessageContainsAWordOfAForeignFile) {
  Random random(17);
  int refused = 0;
  for (const std::string form : kForeign) {
    std::string text;
    std::vector<std::string> secrets;
    for (const char c : form) {
      if (c == '@') secrets.push_back(secret(random));
      text += c == '@' ? secrets.back() : std::string(1, c);
    }
    const TemporaryFile file(text);
    for (const Reader& reader : readers()) {
      const std::string message = messageOf(reader, file.path());
      refused += message.empty() ? 0 : 1;
      for (const std::string& word : secrets) {
        EXPECT_FALSE(has(message, word)) << "\n... of\n" << text;
        EXPECT_FALSE(has(message, word.substr(1, 5)));
      }
    }
  }
  EXPECT_GT(refused, 200) << "nothing is told where nothing is refused";
}

TEST(HostileFiles, NoMessageContainsACellOfADataSet) {
  const Scene scene = sceneOf(kSpatialScene);
  const std::string corners =
      "capture,pressure_1_kpa,tag,x1_px,y1_px,x2_px,y2_px,x3_px,y3_px,x4_px,y4_px\n";
  const std::string tables[] = {
      corners + "1,77123.5,3,1,2,3,4,5,6,7,8\n",
      corners + "-77123.5,0,3,1,2,3,4,5,6,7,8\n",
      corners + "1,0,77123.5,1,2,3,4,5,6,7,8\n",
      corners + "1,0,3,1,2,3,4,5,6,77123.5x,8\n",
      corners + "1,0,3,1,2,3,4,5,6,77123.5e301,8\n",
      "capture,tag,x_m,y_m,z_m,qx,qy,qz,qw,pressure_1_kpa\n1,3,0,0,0,77123.5,0,0,0,0\n",
      "pressure_1_kpa,curvature_rad\n1,-77123.5\n",
      "pressure_1_kpa,curvature_rad\n1,77123.5,2\n",
      "time_s,x_m,y_m,z_m\n0,0,0,0\n-77123.5,0,0,77123.5e3\n",
  };
  for (const std::string& table : tables) {
    const TemporaryFile file(table);
    for (const Reader& reader : readers()) {
      const std::string message = messageOf(reader, file.path());
      EXPECT_FALSE(has(message, "77123"));
    }
    const std::string message = messageOf(readers().back(), file.path());
    EXPECT_FALSE(message.empty()) << table;
  }
}

constexpr double kMostMegabytes = 500;
constexpr std::size_t kMostLetters = 200'000;

void expectBounded(const std::string& what, const std::string& text,
                   const std::function<std::string(const std::string& path)>& read) {
  const TemporaryFile file(text);
  const test::ChildRun run = test::runInChild([&] { return read(file.path()); });
  EXPECT_EQ(run.signal, 0) << what;
  EXPECT_LT(run.megabytes, kMostMegabytes) << what;
  EXPECT_LT(run.text.size(), kMostLetters) << what;
  std::cout << what << ": " << run.megabytes << " MB, says " << run.text.substr(0, 150) << "\n";
}

TEST(HostileFiles, TablesAreReadInBoundedMemory) {
  if (!test::isFullSize()) GTEST_SKIP() << test::kFullSizeOnly;
  const auto load = [](const std::string& path) {
    return messageOf([](const std::string& file) { loadDataSet(file); }, path);
  };
  const std::string name(5'000'000, 'n');
  expectBounded("a long name", name + "\n" + repeated("x\n", 1000), load);
  expectBounded("a long name twice", name + "," + name + "\n1,2\n", load);
  expectBounded("a long cell", "a,b\n" + repeated("1," + name + "\n", 10), load);
  expectBounded("a long row", "a,b\n" + repeated("1,", 16'000'000) + "\n", load);
  expectBounded("a long header", repeated("a,", 16'000'000) + "\n1\n", load);
  expectBounded("many rows", "a\n" + repeated("1\n", 16'000'000), load);
  expectBounded("many comments", repeated("#\n", 16'000'000) + "a\n1\n", load);
  expectBounded("many faults", "a\n" + repeated("x\n", 16'000'000), load);
}

}  // namespace
}  // namespace helix_arm::io
