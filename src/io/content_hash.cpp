#include "helix_arm/io/content_hash.hpp"

#include <array>
#include <memory>

#include <openssl/evp.h>

#include "helix_arm/io/file_error.hpp"

namespace helix_arm::io {
namespace {

constexpr std::size_t kBlock = 1 << 16;

class Sha256 {
 public:
  Sha256() : context_(EVP_MD_CTX_new(), &EVP_MD_CTX_free) {
    check(context_ != nullptr && EVP_DigestInit_ex(context_.get(), EVP_sha256(), nullptr) == 1);
  }
  void add(const void* bytes, std::size_t count) {
    check(EVP_DigestUpdate(context_.get(), bytes, count) == 1);
  }
  std::string digits() {
    std::array<unsigned char, EVP_MAX_MD_SIZE> digest{};
    unsigned int size = 0;
    check(EVP_DigestFinal_ex(context_.get(), digest.data(), &size) == 1);
    std::string text;
    for (unsigned int i = 0; i < size; ++i) {
      text += "0123456789abcdef"[digest[i] >> 4];
      text += "0123456789abcdef"[digest[i] & 15];
    }
    return text;
  }

 private:
  static void check(bool done) {
    if (!done) throw std::runtime_error("SHA-256 is not available from OpenSSL");
  }

  std::unique_ptr<EVP_MD_CTX, decltype(&EVP_MD_CTX_free)> context_;
};

}  // namespace

std::string sha256Of(const std::string& content) {
  Sha256 hash;
  hash.add(content.data(), content.size());
  return hash.digits();
}

std::string sha256OfFile(basics::RegularFile& file, const std::string& path, std::uint64_t most) {
  const auto refuse = [&path](const std::string& fault) {
    const bool complete = fault.find("; expected ") != std::string::npos;
    throw FileError(path + " " + fault + (complete ? "" : "; expected an existing, readable file"));
  };
  const std::string too_large = basics::largerThan(most) + "; expected a smaller file";
  if (!file.isOpen()) refuse(file.fault());
  if (file.size() > most) refuse(too_large);
  Sha256 hash;
  std::string block(kBlock, '\0');
  std::uint64_t place = 0;
  for (ssize_t count; (count = file.readAt(place, block.data(), block.size())) != 0;) {
    if (count < 0) refuse(file.fault());
    place += static_cast<std::uint64_t>(count);
    if (place > most) refuse(too_large);
    hash.add(block.data(), static_cast<std::size_t>(count));
  }
  return hash.digits();
}

std::string sha256OfFile(const std::string& path) {
  constexpr std::uint64_t kMost = 64U << 20U;
  basics::RegularFile file(path);
  return sha256OfFile(file, path, kMost);
}

}  // namespace helix_arm::io
