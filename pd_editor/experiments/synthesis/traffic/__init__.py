"""Traffic on a network: demand, simulation, pedestrians, parked vehicles, tracks."""
