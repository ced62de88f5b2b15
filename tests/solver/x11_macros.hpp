#pragma once

// Common words that X11/X.h and X11/Xlib.h define as macros.
#define Status int
#define Bool int
#define True 1
#define False 0
#define None 0L
#define Success 0
#define Always 2
#define Complex 0
#define Convex 2
#define Above 0
#define Below 1
#define Unsorted 0
