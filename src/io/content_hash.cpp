#include "helix_arm/io/content_hash.hpp"

#include <array>
#include <cerrno>
#include <cstdio>
#include <cstring>
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

std::string sha256OfFile(const std::string& path) {
  const std::unique_ptr<std::FILE, int (*)(std::FILE*)> file(std::fopen(path.c_str(), "rb"),
                                                             &std::fclose);
  const auto refuse = [&path](int error) {
    throw FileError(path + " cannot be read: " + std::strerror(error) +
                    "; expected a file that is there and may be read");
  };
  if (!file) refuse(errno);
  Sha256 hash;
  std::string block(kBlock, '\0');
  for (std::size_t count; (count = std::fread(block.data(), 1, block.size(), file.get())) > 0;) {
    hash.add(block.data(), count);
  }
  if (std::ferror(file.get()) != 0) refuse(errno);
  return hash.digits();
}

}  // namespace helix_arm::io
