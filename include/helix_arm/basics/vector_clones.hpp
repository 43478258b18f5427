#pragma once

/// HELIX_ARM_CLONES before a function compiles it once per instruction set and selects one at load
/// time: Debian compiles for baseline x86-64. Not under the thread sanitizer, which starts after
/// the selection.
#if defined(__x86_64__) && defined(__GNUC__) && !defined(__clang__) && !defined(__SANITIZE_THREAD__)
#define HELIX_ARM_CLONES __attribute__((target_clones("avx512f", "arch=haswell", "default")))
#else
#define HELIX_ARM_CLONES
#endif
