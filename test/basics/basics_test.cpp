#include <filesystem>
#include <fstream>

#include <gtest/gtest.h>
#include <sys/socket.h>
#include <sys/stat.h>
#include <sys/un.h>
#include <unistd.h>

#include "basics/quote.hpp"
#include "basics/regular_file.hpp"
#include "support/temporary_folder.hpp"

namespace helix_arm::basics {
namespace {

TEST(Printable, WhatATerminalObeysBecomesAnEscape) {
  const struct {
    std::string text, line;
  } kCases[] = {{"\x1b]0;x\x07", "\\x1b]0;x\\x07"},
                {"a\rb\tc", "a\\x0db\\x09c"},
                {"a\nerror: b", "a\\x0aerror: b"},
                {"\u009b31m", "\\x9b31m"},  // CSI of C1
                {"\u202e\u2066\u200f\u061c", "\\u202e\\u2066\\u200f\\u061c"},
                {"\x9b\xe4", "\\x9b\\xe4"},  // of Latin-1
                {"\xc0\x8a", "\\xc0\\x8a"},  // an overlong newline
                {"\xe2\x80\u00fc", "\\xe2\\x80\u00fc"}};
  for (const auto& entry : kCases) {
    EXPECT_EQ(printable(entry.text), entry.line);
    EXPECT_EQ(printableLines(entry.text), entry.text == "a\nerror: b" ? entry.text : entry.line);
  }
}

namespace fs = std::filesystem;
using test::TemporaryFolder;

constexpr std::size_t kMost = 1000;

// What reading says; "read" where it gives the bytes.
std::string faultOf(const std::string& path, std::size_t most = kMost) {
  RegularFile file(path);
  return file.readAll(most) ? "read" : file.fault();
}

void write(const std::string& path, const std::string& bytes) {
  std::ofstream(path, std::ios::binary | std::ios::app) << bytes;
}

TEST(RegularFile, TheLimitIsKeptFromBothSidesAndNamed) {
  const TemporaryFolder folder;
  write(folder / "a", std::string(kMost, 'x'));
  write(folder / "b", std::string(kMost + 1, 'x'));
  EXPECT_EQ(faultOf(folder / "a"), "read");
  EXPECT_EQ(faultOf(folder / "b"), "is larger than 1000 bytes");
  EXPECT_EQ(faultOf(folder / "b", 1), "is larger than 1 bytes");
  EXPECT_EQ(largerThan(4U << 20U), "is larger than 4 MiB");
  EXPECT_EQ(largerThan(16ULL << 30U), "is larger than 16 GiB");
}

// Each of them would block who opens it, or have no end.
TEST(RegularFile, OtherThanRegularFilesAreRefusedWithoutWaiting) {
  const TemporaryFolder folder;
  const std::string fifo = folder / "fifo", socket = folder / "socket";
  ASSERT_EQ(::mkfifo(fifo.c_str(), 0600), 0);
  sockaddr_un address{};
  address.sun_family = AF_UNIX;
  socket.copy(address.sun_path, sizeof address.sun_path - 1);
  const int listener = ::socket(AF_UNIX, SOCK_STREAM, 0);
  ASSERT_EQ(::bind(listener, reinterpret_cast<const sockaddr*>(&address), sizeof address), 0);
  fs::create_symlink(fifo, folder / "link");
  EXPECT_EQ(faultOf(fifo), "is a FIFO; expected a regular file");
  EXPECT_EQ(faultOf(folder / "link"), "is a FIFO; expected a regular file");
  EXPECT_EQ(faultOf(socket), "is a socket; expected a regular file");
  for (const char* device : {"/dev/zero", "/dev/null", "/dev/full", "/dev/ptmx"}) {
    EXPECT_EQ(faultOf(device), "is a device; expected a regular file");
  }
  EXPECT_EQ(faultOf(folder.path()), "cannot be read: Is a directory");
  EXPECT_EQ(faultOf(folder / "nothing"), "cannot be read: No such file or directory");
  EXPECT_EQ(faultOf(""), "cannot be read: No such file or directory");
  ::close(listener);
}

}  // namespace
}  // namespace helix_arm::basics
