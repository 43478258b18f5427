#pragma once

/// HELIX_ARM_CLONES before a function compiles it once per instruction set and selects one at load
/// time: Debian compiles for baseline x86-64. The sets are features, which GCC takes from version
/// 12 on; the name of a processor, such as haswell, stands for that one alone. Not under the thread
/// sanitizer, which starts after the selection, nor where a test defines it otherwise.
#ifdef HELIX_ARM_CLONES
#elif defined(__x86_64__) && !defined(__clang__) && __GNUC__ >= 12 && !defined(__SANITIZE_THREAD__)
#define HELIX_ARM_CLONES __attribute__((target_clones("avx512f", "arch=x86-64-v3", "default")))
#else
#define HELIX_ARM_CLONES
#endif
