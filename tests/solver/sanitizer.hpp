#pragma once

// Defines ASTERISM_TEST_SANITIZED if AddressSanitizer or ThreadSanitizer has replaced malloc.
#if defined(__SANITIZE_ADDRESS__) || defined(__SANITIZE_THREAD__)
#define ASTERISM_TEST_SANITIZED
#elif defined(__has_feature)
#if __has_feature(address_sanitizer) || __has_feature(thread_sanitizer)
#define ASTERISM_TEST_SANITIZED
#endif
#endif
