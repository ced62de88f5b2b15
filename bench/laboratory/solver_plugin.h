/* A solver in a shared library, for asterism-bench --plugin. In C, so that it may be written in any language.
 */
#ifndef ASTERISM_SOLVER_PLUGIN_H
#define ASTERISM_SOLVER_PLUGIN_H

#ifdef __cplusplus
extern "C" {
#endif

/* A system of springs between nodes in the plane, as in docs/system-json.md, and its energy. Arrays of points
   have x and y of each node in turn. All is valid until `minimise` returns. */
typedef struct asterism_problem {
  int nodes;
  int links;
  const double* start;            /* 2 * nodes: a point */
  const double* anchors;          /* 2 * nodes */
  const double* anchor_stiffness; /* nodes */
  const int* ends;                /* 2 * links: the two nodes of each link, from 0 */
  const double* rest_length;      /* links */
  const double* link_stiffness;   /* links */
  const double* rest_offset;      /* 2 * links, or null if no link has one */
  const unsigned char* fixed;     /* nodes: 1 if the node does not move */
  int max_iterations;

  /* The energy at x (2 * nodes) and, if `gradient` is not null, its gradient (2 * nodes), 0 for fixed nodes.
   * Each call is counted. */
  double (*evaluate)(const struct asterism_problem* problem, const double* x, double* gradient);
  /* To be called after each iteration. Not 0 if the solver has to return: the point of the lowest energy that
     has been evaluated with its gradient is stationary by the stopping rule that all solvers share, or the
     caller has asked to stop. */
  int (*iterated)(const struct asterism_problem* problem);
  void* state; /* of asterism-bench */
} asterism_problem;

typedef struct asterism_solver {
  int version;       /* ASTERISM_SOLVER_VERSION */
  const char* name;  /* as in --solvers */
  const char* title; /* as in tables */
  int dense_nodes;   /* the most nodes with which the experiments run it, in fully linked systems */
  int sparse_nodes;  /* and in systems of local links */
  /* Minimises the energy. x is the start; the result is x, or the lowest point that was evaluated if that is
     lower. Returns 0, or another number if it failed. Must not throw, nor use other threads after it has
     returned. */
  int (*minimise)(const asterism_problem* problem, double* x);
} asterism_solver;

#define ASTERISM_SOLVER_VERSION 1

/* The one symbol that a library has to export. */
#ifdef _WIN32
__declspec(dllexport)
#else
__attribute__((visibility("default")))
#endif
    extern const asterism_solver asterism_solver_plugin;

#ifdef __cplusplus
}
#endif

#endif
