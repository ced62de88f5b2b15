#pragma once

/// Marks the symbols of the compiled libraries that users call: they are visible in shared libraries, whose
/// other symbols are hidden. The build defines it as nothing for static libraries, so that their calls need
/// not be replaceable.
#ifndef ASTERISM_API
#define ASTERISM_API __attribute__((visibility("default")))
#endif
