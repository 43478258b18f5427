// No recording, however damaged, ends the process that loads it.
#include <filesystem>
#include <fstream>
#include <iostream>
#include <sstream>

#include <gtest/gtest.h>
#include <sys/stat.h>
#include <sys/wait.h>

#include "bag/bag_captures.hpp"
#include "helix_arm/io/atomic_file.hpp"
#include "helix_arm/io/fault_list.hpp"
#include "support/random.hpp"
#include "support/recording.hpp"
#include "support/temporary_folder.hpp"

namespace helix_arm::ros_bridge {
namespace {

using test::Random;
using test::Recording;

constexpr int kDamaged = 200;

std::string contentOf(const std::string& path) {
  std::ostringstream content;
  content << std::ifstream(path, std::ios::binary).rdbuf();
  return content.str();
}

void write(const std::string& path, const std::string& bytes) {
  std::ofstream(path, std::ios::binary) << bytes;
}

// A recording in which the arm is at rest twice.
std::string soundBag(const test::TemporaryFolder& folder) {
  Recording recording(folder / "sound.bag");
  recording.play({0, 0, 0}, 3);
  recording.play({1e5, 2e5, 0}, 3);
  return contentOf(recording.close());
}

// One byte is another, some are, a piece is missing, or the end is.
std::string damaged(std::string bytes, Random& random) {
  const auto place = [&] {
    // Half of them where the bag tells of itself: at its beginning and in the index at its end.
    const int size = static_cast<int>(bytes.size());
    const int part = random.integer(0, 3);
    return static_cast<std::size_t>(part == 0   ? random.integer(0, std::min(size, 6000) - 1)
                                    : part == 1 ? random.integer(std::max(0, size - 6000), size - 1)
                                                : random.integer(0, size - 1));
  };
  const auto change = [&] { bytes[place()] = static_cast<char>(random.integer(0, 255)); };
  switch (random.integer(0, 3)) {
    case 0:
      change();
      break;
    case 1:
      for (int i = random.integer(2, 20); i > 0; --i) change();
      break;
    case 2:
      bytes.erase(place(), static_cast<std::size_t>(random.integer(1, 100)));
      break;
    default:
      bytes.resize(place());
  }
  return bytes;
}

std::size_t openFiles() {
  std::size_t count = 0;
  for ([[maybe_unused]] const auto& file : std::filesystem::directory_iterator("/proc/self/fd")) {
    ++count;
  }
  return count;
}

TEST(DamagedBags, NeverEndWhoLoadsThem) {
  const test::TemporaryFolder folder;
  const std::string sound = soundBag(folder), path = folder / "damaged.bag";
  const io::Scene scene = test::demo();
  Random random(19);
  const std::size_t files = openFiles();
  int loaded = 0, refused = 0, crashed = 0;
  for (int i = 0; i < kDamaged; ++i) {
    write(path, damaged(sound, random));
    try {
      loadBag(path, scene, {});
      ++loaded;
    } catch (const io::DocumentError& fault) {
      const std::string message = fault.what();
      ++refused;
      crashed += message.find("reading it ended with") != std::string::npos ? 1 : 0;
      EXPECT_EQ(message.find(path), 0u) << message;
      EXPECT_LT(message.size(), 1000u) << message;
    }
  }
  EXPECT_GT(loaded, 20) << "a byte within a message is no fault of the bag";
  EXPECT_GT(refused, 60);
  std::cout << loaded << " were read, " << refused << " refused, " << crashed
            << " of them having ended bag_reader\n";
  EXPECT_EQ(openFiles(), files);
  EXPECT_EQ(waitpid(-1, nullptr, WNOHANG), -1) << "no process is left behind";
}

TEST(DamagedBags, WhatEndsTheReaderIsAFaultThatNamesTheBag) {
  const test::TemporaryFolder folder;
  const std::string sound = soundBag(folder), path = folder / "damaged.bag";
  // The length of the first record's header, after the line that names the format.
  const std::size_t length = sound.find('\n') + 1;
  std::string bytes = sound;
  bytes.replace(length, 4, "\xff\xff\xff\x7f");
  write(path, bytes);
  try {
    loadBag(path, test::demo(), {});
    FAIL();
  } catch (const io::DocumentError& fault) {
    EXPECT_EQ(std::string(fault.what()).find(path), 0u) << fault.what();
  }
}

TEST(DamagedBags, OnlyRegularFilesAreRead) {
  const test::TemporaryFolder folder;
  const std::string fifo = folder / "fifo.bag";
  ASSERT_EQ(mkfifo(fifo.c_str(), 0600), 0);
  for (const std::string& path : {fifo, std::string("/dev/zero"), folder.path()}) {
    try {
      loadBag(path, test::demo(), {});
      FAIL() << path;
    } catch (const io::DocumentError& fault) {
      EXPECT_EQ(std::string(fault.what()).find(path + " "), 0u) << fault.what();
    }
  }
}

TEST(DamagedBags, TheHashIsOfTheBytesThatWereRead) {
  const test::TemporaryFolder folder;
  const std::string bytes = soundBag(folder);
  const procedures::CalibrationData data =
      loadMeasurements(test::demo(), {folder / "sound.bag"}, {});
  ASSERT_EQ(data.sources.size(), 1u);
  EXPECT_EQ(data.sources[0].sha256, io::sha256Of(bytes));
  EXPECT_EQ(data.sources[0].captures, 2);
}

}  // namespace
}  // namespace helix_arm::ros_bridge
