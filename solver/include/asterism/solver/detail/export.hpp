#pragma once

/// On what the compiled libraries define for their users: visible in shared libraries, whose other symbols
/// are hidden. The build defines it as nothing where it compiles a static library, whose calls then need not
/// be replaceable.
#ifndef ASTERISM_API
#define ASTERISM_API __attribute__((visibility("default")))
#endif
