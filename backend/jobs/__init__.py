"""What each job of the registry does, a module a job: values of a bundle in, values of a bundle out."""
