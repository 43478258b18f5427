#pragma once

/// Which mutex guards what, for Clang's thread-safety analysis (-Wthread-safety): see
/// https://clang.llvm.org/docs/ThreadSafetyAnalysis.html. Other compilers see nothing.
///
/// The test `thread_safety_test` runs the analysis. It is done per function: it checks neither
/// constructors nor destructors, and a lambda does not inherit the locks of the function that
/// contains it.

#if defined(__clang__)
#define HELIX_ARM_THREAD_ANNOTATION(attribute) __attribute__((attribute))
#else
#define HELIX_ARM_THREAD_ANNOTATION(attribute)
#endif

/// Of a class: its objects can be locked. `kind` is the word in the messages: "mutex".
#define HELIX_ARM_CAPABILITY(kind) HELIX_ARM_THREAD_ANNOTATION(capability(kind))

/// Of a class: it locks in its constructor and unlocks in its destructor.
#define HELIX_ARM_SCOPED_CAPABILITY HELIX_ARM_THREAD_ANNOTATION(scoped_lockable)

/// Of a member: it is read and written with this mutex locked only.
#define HELIX_ARM_GUARDED_BY(mutex) HELIX_ARM_THREAD_ANNOTATION(guarded_by(mutex))

/// Of a function or a lambda: whoever calls it has locked these mutexes.
#define HELIX_ARM_REQUIRES(...) HELIX_ARM_THREAD_ANNOTATION(requires_capability(__VA_ARGS__))

/// Of a function: whoever calls it has not locked these mutexes, since it locks them itself.
#define HELIX_ARM_EXCLUDES(...) HELIX_ARM_THREAD_ANNOTATION(locks_excluded(__VA_ARGS__))

/// Of a function: it locks these mutexes, or its own object without an argument.
#define HELIX_ARM_ACQUIRE(...) HELIX_ARM_THREAD_ANNOTATION(acquire_capability(__VA_ARGS__))

/// Of a function: it unlocks these mutexes, or its own object without an argument.
#define HELIX_ARM_RELEASE(...) HELIX_ARM_THREAD_ANNOTATION(release_capability(__VA_ARGS__))
