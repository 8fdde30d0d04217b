"""What calls read by themselves: questions to the project's folder, their answers, and which results these lead to."""
