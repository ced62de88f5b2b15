#include <asterism/solver/distributed/petsc.hpp>

int main(int argc, char** argv) {
  const asterism::PetscRuntime runtime(argc, argv);  // MPI and PETSc, if the program has not initialised them
  auto share = asterism::read_petsc<2>(MPI_COMM_WORLD, "large.petsc");  // an equal share for each process
  asterism::DistributedSystem<2> system(MPI_COMM_WORLD, share);         // partitions
  const asterism::Summary summary = system.solve();                     // the same on all processes
  share.start = system.placement();  // each process gets the nodes of its share
  asterism::write_petsc(MPI_COMM_WORLD, "solved.petsc", share);
  return summary.status == asterism::Status::Converged ? 0 : 1;
}
