# Debian's cross compiler for arm64, and qemu to run what it makes. HELIX_ARM_ARM64_PACKAGES is the folder that holds the libraries of
# arm64, as scripts/arm64 unpacks them.
set(CMAKE_SYSTEM_NAME Linux)
set(CMAKE_SYSTEM_PROCESSOR aarch64)
set(CMAKE_CXX_COMPILER aarch64-linux-gnu-g++)
set(CMAKE_LIBRARY_ARCHITECTURE aarch64-linux-gnu)
list(APPEND CMAKE_TRY_COMPILE_PLATFORM_VARIABLES HELIX_ARM_ARM64_PACKAGES)
set(CMAKE_FIND_ROOT_PATH ${HELIX_ARM_ARM64_PACKAGES})
set(CMAKE_FIND_ROOT_PATH_MODE_PROGRAM NEVER)
set(CMAKE_FIND_ROOT_PATH_MODE_LIBRARY ONLY)
set(CMAKE_FIND_ROOT_PATH_MODE_INCLUDE BOTH)  # Eigen has headers alone
set(CMAKE_FIND_ROOT_PATH_MODE_PACKAGE BOTH)
set(libraries ${HELIX_ARM_ARM64_PACKAGES}/usr/lib/aarch64-linux-gnu)
set(CMAKE_EXE_LINKER_FLAGS_INIT "-L${libraries} -Wl,-rpath-link,${libraries}")
set(CMAKE_CXX_FLAGS_INIT "-isystem ${HELIX_ARM_ARM64_PACKAGES}/usr/include/aarch64-linux-gnu")
set(CMAKE_SHARED_LINKER_FLAGS_INIT "${CMAKE_EXE_LINKER_FLAGS_INIT}")
set(CMAKE_CROSSCOMPILING_EMULATOR qemu-aarch64;-L;/usr/aarch64-linux-gnu;-E;LD_LIBRARY_PATH=${libraries})
