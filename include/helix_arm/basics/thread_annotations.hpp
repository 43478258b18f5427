#pragma once

/// Annotations for Clang's thread-safety analysis (-Wthread-safety):
/// https://clang.llvm.org/docs/ThreadSafetyAnalysis.html. They are empty for other compilers.
///
/// The test `thread_safety_test` runs the analysis. It works per function: it checks neither
/// constructors nor destructors, and a lambda does not inherit the locks of the function that
/// contains it.

#if defined(__clang__)
#define HELIX_ARM_THREAD_ANNOTATION(attribute) __attribute__((attribute))
#else
#define HELIX_ARM_THREAD_ANNOTATION(attribute)
#endif

/// For a class: its objects can be locked. `kind` is the word in messages: "mutex".
#define HELIX_ARM_CAPABILITY(kind) HELIX_ARM_THREAD_ANNOTATION(capability(kind))

/// For a class: it locks in its constructor and unlocks in its destructor.
#define HELIX_ARM_SCOPED_CAPABILITY HELIX_ARM_THREAD_ANNOTATION(scoped_lockable)

/// For a member: it may be read and written only with this mutex locked.
#define HELIX_ARM_GUARDED_BY(mutex) HELIX_ARM_THREAD_ANNOTATION(guarded_by(mutex))

/// For a function or a lambda: the caller must have locked these mutexes.
#define HELIX_ARM_REQUIRES(...) HELIX_ARM_THREAD_ANNOTATION(requires_capability(__VA_ARGS__))

/// For a function: the caller must not have locked these mutexes, since the function locks them.
#define HELIX_ARM_EXCLUDES(...) HELIX_ARM_THREAD_ANNOTATION(locks_excluded(__VA_ARGS__))

/// For a function: it locks these mutexes or, without an argument, its own object.
#define HELIX_ARM_ACQUIRE(...) HELIX_ARM_THREAD_ANNOTATION(acquire_capability(__VA_ARGS__))

/// For a function: it unlocks these mutexes or, without an argument, its own object.
#define HELIX_ARM_RELEASE(...) HELIX_ARM_THREAD_ANNOTATION(release_capability(__VA_ARGS__))
