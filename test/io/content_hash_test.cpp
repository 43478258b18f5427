#include <gtest/gtest.h>

#include "helix_arm/io/atomic_file.hpp"
#include "support/temporary_file.hpp"
#include "support/temporary_folder.hpp"

namespace helix_arm::io {
namespace {

// From FIPS 180-2, appendix B, and NIST's vectors of the empty message.
TEST(Sha256, IsThatOfTheStandard) {
  EXPECT_EQ(sha256Of(""), "e3b0c44298fc1c149afbf4c8996fb92427ae41e4649b934ca495991b7852b855");
  EXPECT_EQ(sha256Of("abc"), "ba7816bf8f01cfea414140de5dae2223b00361a396177a9cb410ff61f20015ad");
  EXPECT_EQ(sha256Of("abcdbcdecdefdefgefghfghighijhijkijkljklmklmnlmnomnopnopq"),
            "248d6a61d20638b8e5c026930c3e6039a33ce45964ff2167f6ecedd419db06c1");
  EXPECT_EQ(sha256Of(std::string(1000000, 'a')),
            "cdc76e5c9914fb9281a1c7e284d73e67f1809a48a497200e046d39ccc7112cd0");
}

TEST(Sha256, OfAFileIsThatOfItsBytes) {
  std::string bytes;
  for (int i = 0; i < 300000; ++i) bytes += static_cast<char>(i * 7 + i / 251);
  EXPECT_EQ(sha256OfFile(test::TemporaryFile(bytes).path()), sha256Of(bytes));
  EXPECT_EQ(sha256OfFile(test::TemporaryFile("").path()), sha256Of(""));
}

TEST(Sha256, OfAFileThatCannotBeReadIsRefused) {
  const test::TemporaryFolder folder;
  const auto message = [](const std::string& path) {
    try {
      sha256OfFile(path);
    } catch (const FileError& error) {
      return std::string(error.what());
    }
    return std::string();
  };
  const std::string expected = "; expected an existing, readable file";
  EXPECT_EQ(message("/nowhere.csv"),
            "/nowhere.csv cannot be read: No such file or directory" + expected);
  EXPECT_EQ(message(folder.path()), folder.path() + " cannot be read: Is a directory" + expected);
}

}  // namespace
}  // namespace helix_arm::io
