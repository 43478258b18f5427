#include "media.hpp"

#include <stdexcept>

#include <dlfcn.h>

namespace helix_arm::vision {
namespace {

constexpr char kLibrary[] = "libhelix_arm_media.so";

const Media& load() {
  void* library = dlopen(kLibrary, RTLD_NOW | RTLD_LOCAL);
  const void* symbol = library == nullptr ? nullptr : dlsym(library, "helix_arm_media");
  if (symbol == nullptr) {
    const char* fault = dlerror();
    throw std::runtime_error(
        std::string("videos, webcams and pictures other than JPEG and PNG need ") + kLibrary +
        ", which does not load: " + (fault == nullptr ? "it is empty" : fault) +
        "; build or install helix_arm again");
  }
  return *static_cast<const Media*>(symbol);
}

}  // namespace

const Media& media() {
  static const Media& loaded = load();
  return loaded;
}

}  // namespace helix_arm::vision
